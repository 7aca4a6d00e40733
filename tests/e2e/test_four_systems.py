"""One simulated wearer by Vicon, OptiTrack, Xsens and Noitom into IKNS' angles and the skeleton: how far apart.

`-s` prints the tables of docs/capture-systems.md. All of it is simulated: no system's real errors are in it.
"""

from __future__ import annotations

import io

import numpy as np
import pytest
from helpers.four_systems import SYSTEMS, profile
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.signals import Array
from srl.testing import simulate

pytestmark = pytest.mark.slow
SECONDS = {True: 3, False: 6}
SETTLED = 150  # rows, until everything was seen
SHOWN = ("Hips", "Spine3", "Head", "RightArm", "RightHand", "LeftHand", "RightFoot")


@pytest.fixture(scope="module", params=[True, False], ids=["exact", "noisy"])
def run(request):
    """With fakes that neither err nor lag, and with their noise and delay as they come."""
    text = io.StringIO()
    YAML().dump(profile(exact=request.param), text)
    return simulate(text.getvalue(), SECONDS[request.param]), request.param


def nodes(rotation: Array, translation: Array) -> Array:
    """(n, 59, 3) m in the room: plain forward kinematics, as an oracle."""
    skeleton = Skeleton("axis-neuron")
    turns: list[Rotation] = []
    places: list[Array] = []
    for i, parent in enumerate(skeleton.parents):
        own = Rotation.from_quat(rotation[:, i], scalar_first=True)
        turns.append(own if parent < 0 else turns[parent] * own)
        places.append(translation[:, i] if parent < 0 else places[parent] + turns[parent].apply(translation[:, i]))
    return np.stack(places, axis=1)[:, :, [2, 0, 1]]  # x left, y up, z ahead is y, z, x of the room


def whole(run, system: str) -> Array:
    owner = "noitom" if system == "noitom" else f"{system}_suit"
    return nodes(run.value(f"{owner}.rotation")[SETTLED:], run.value(f"{owner}.translation")[SETTLED:])


def test_the_skeleton_is_the_same_person_s(run):
    rows, exact = run
    truth = rows.value("world.wearer_position")[SETTLED:]
    names = Skeleton("axis-neuron").names
    print(f"\nmm from where the simulated wearer is, rms ({'exact' if exact else 'noise and delay of the fakes'})")
    for system in SYSTEMS:
        off = np.linalg.norm(whole(rows, system) - truth, axis=2)
        rms = dict(zip(names, 1e3 * np.sqrt((off**2).mean(axis=0)), strict=True))
        print(f"{system:10}", *(f"{name} {rms[name]:.1f}" for name in SHOWN))
        assert max(rms[name] for name in SHOWN) < (2.0 if exact else 40.0)


def test_ikns_gets_the_same_angles(run):
    rows, exact = run
    angles = {system: np.rad2deg(rows.value(f"{system}_arm.angles")[SETTLED:]) for system in SYSTEMS}
    hands = {system: rows.value(f"{system}_arm.hand")[SETTLED:, :3] for system in SYSTEMS}
    held = {system: rows.value(f"{system}_arm.held")[SETTLED:].max(axis=1) > 0 for system in SYSTEMS}
    print(f"\ndegrees and mm from Vicon, rms ({'exact' if exact else 'noise and delay of the fakes'})")
    for system in SYSTEMS:
        both = ~(held[system] | held["vicon"])
        assert both.mean() > 0.9
        off = (angles[system] - angles["vicon"])[both]
        rms = np.sqrt((off**2).mean(axis=0))
        hand = 1e3 * np.sqrt(((hands[system] - hands["vicon"])[both] ** 2).sum(axis=1).mean())
        print(f"{system:10}", *(f"{value:.2f}" for value in rms), f"hand {hand:.1f} mm", f"both {both.mean():.2f}")
        assert rms.max() < (0.5 if exact else 8.0)
        assert hand < (2.0 if exact else 40.0)
    assert np.ptp(angles["vicon"], axis=0).max() > 20.0  # it moves
