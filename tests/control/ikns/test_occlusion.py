"""`arm-angles` and `ikns` together: c while markers are hidden, and how it comes back; c after a circle of the arm."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import ROOT
from helpers.control import bound
from helpers.mocap import made

from srl.control.ikns.arm_angles import ArmAngles, ArmAnglesConfig
from srl.control.ikns.law import Ikns, IknsConfig
from srl.runtime.contracts import rotation
from srl.runtime.models.body import average
from srl.runtime.models.models import BodyModel

ARM = average(1.75, ("right",))
DT, CATCH_UP = 0.01, 1.0
HIDDEN = ("rsho", "rupa", "relb", "rfrm", "rwra", "rwrb", "rfin")
# Elbow down and elbow out, the hand nearly in one place: clavicle and arm, degrees.
DOWN, OUT = (0, 0, 9, 12, 4, 118, 11, 25, -2), (0, 0, 71, 33, 37, 120, -25, -52, -9)


class Wearer:
    """Both laws behind markers, and the c of the true angles."""

    def __init__(self, q: np.ndarray) -> None:
        file = str(ROOT / "profiles/ikns-finger.calibration.json")
        self.arm = bound(ArmAngles("arm", ArmAnglesConfig(body=BodyModel(stature=1.75, sides=("right",)))))
        self.law, self.true = (bound(Ikns(name, IknsConfig(calibration=file, clamp=False))) for name in ("c", "true"))
        self._see(q, ())
        for law in (self.arm, self.law, self.true):
            if law is not self.arm:
                self._hand_on(q)
            law.reset()

    def step(self, q: np.ndarray, *hidden: str) -> tuple[float, float, bool]:
        """c, the true c, and whether c is held."""
        self._see(q, hidden)
        self.arm.update(DT)
        self._hand_on(q)
        self.law.update(DT)
        self.true.update(DT)
        return float(self.law.output["c"][0]), float(self.true.output["c"][0]), bool(self.law.output["held"][0])

    def _see(self, q: np.ndarray, hidden: tuple[str, ...]) -> None:
        self.arm.input["markers"][:] = made(ARM, q)
        self.arm.input["marker_visible"][:] = [name not in hidden for name in self.arm.inputs[0].labels]

    def _hand_on(self, q: np.ndarray) -> None:
        for name in ("angles", "hand", "held"):
            self.law.input[name][:] = self.arm.output[name]
        self.true.input["angles"][:] = q[list(ARM.chains["right_arm"])]
        poses = ARM.forward(q)
        palm = np.linalg.inv(poses["torso"]) @ poses["right_hand"] @ [*ARM.grip("right"), 1.0]
        self.true.input["hand"][:] = (*palm[:3], 1.0, 0.0, 0.0, 0.0)


def posture(share: float) -> np.ndarray:
    q = np.zeros(len(ARM.joints))
    q[6:] = np.deg2rad(DOWN) + share * np.deg2rad(np.subtract(OUT, DOWN))
    return q


@pytest.mark.parametrize("hidden", [HIDDEN, ("rfin",)], ids=["arm", "fin"])
@pytest.mark.parametrize("seconds", [0.5, 1.0, 1.5])
def test_after_an_occlusion_c_catches_up_and_no_faster(seconds: float, hidden: tuple[str, ...]) -> None:
    """The elbow goes out while it is hidden, and moves on when it is seen again."""
    frames = round(seconds / DT)
    shares = [0.1] * 30 + np.linspace(0.1, 0.8, frames).tolist()
    shares += (0.8 + 0.1 * np.sin(np.arange(150) * 2 * np.pi * DT)).tolist()
    wearer = Wearer(posture(shares[0]))
    rows = [wearer.step(posture(s), *(hidden if 30 <= i < 30 + frames else ())) for i, s in enumerate(shares)]
    c, true, held = np.array(rows).T
    assert held[30 : 30 + frames].all()
    assert np.ptp(c[29 : 30 + frames]) < 1e-9
    assert abs(true[30 + frames] - true[29]) > 0.3
    assert not held[30 + frames :].any()
    beyond = np.abs(np.diff(c) - np.diff(true))[29 + frames :] / DT
    assert beyond.max() < CATCH_UP + 0.1
    assert abs(c[-1] - true[-1]) < 0.02


@pytest.mark.parametrize(
    ("cone", "sense"),
    [(25.0, 1.0), (40.0, -1.0), *(pytest.param(*at, marks=pytest.mark.slow) for at in ((25.0, -1.0), (40.0, 1.0)))],
)
def test_after_a_circle_about_straight_forward_c_is_what_it_was(cone: float, sense: float) -> None:
    """As in wiping a window: the shoulder's order XYZ turns by a whole turn about its singularity."""
    q = posture(0.3)
    up = q.copy()
    first, second, third, elbow = ARM.chains["right_arm"][:4]
    up[second], up[elbow] = np.deg2rad(90.0 - cone), np.deg2rad(70.0)
    ease = lambda n: 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n))[:, None]  # noqa: E731
    circle = np.repeat(up[None], 300, axis=0)
    circle[:, [first, third]] += 2 * np.pi * sense * ease(300) * (1.0, -1.0)
    motion = [*q + ease(150) * (up - q), *circle, *up + ease(150) * (q - up), *[q] * 150]
    wearer = Wearer(q)
    before = wearer.arm.output["angles"].copy()
    found, held, angles = [], [], []
    for row in motion:
        c, _, _ = wearer.step(row)
        found.append(c)
        held.append(wearer.arm.output["held"].copy())
        angles.append(wearer.arm.output["angles"].copy())
    np.testing.assert_allclose(angles[-1], before, atol=np.deg2rad(0.1))
    assert abs(found[-1] - found[0]) < 0.01
    steps, again = np.abs(np.diff(angles, axis=0)), np.array(held)[:-1] > np.array(held)[1:]
    assert steps[again].max() > 3.0  # an angle does go back by half a turn or more
    assert steps[~again].max() < 0.3
    assert 1 <= np.array(held).any(axis=1).sum() <= 8
    # A turn would move c by several ranges at once.
    assert np.abs(np.diff(found)).max() < 0.2


@pytest.mark.slow
@pytest.mark.sampled
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("cone", [5.0, 10.0, 15.0])
@pytest.mark.parametrize("turned", [-60.0, -30.0, 0.0, 60.0, 30.0])
def test_after_a_narrow_circle_it_is_held_or_what_it_was(cone: float, sense: float, turned: float) -> None:
    """The upper arm, nearly straight forward, circles without turning about itself; the elbow is bent by 60 degrees."""
    q = posture(0.0)
    first, second, third, elbow = ARM.chains["right_arm"][:4]
    q[elbow] = np.deg2rad(60.0)

    def at(angle: float) -> np.ndarray:
        tilt = rotation.matrix(rotation.exp(0.0, *(np.deg2rad(cone) * np.array([-np.sin(angle), np.cos(angle)]))))
        own = rotation.matrix(rotation.exp(np.deg2rad(turned), 0.0, 0.0))
        arm = tilt @ own @ rotation.matrix(rotation.exp(0.0, -np.pi / 2, 0.0))
        there = q.copy()
        there[[first, second, third]] = rotation.euler_angles(arm[None], "XYZ")[0] * (-1.0, -1.0, 1.0)
        return there

    circle = [at(angle) for angle in sense * 2 * np.pi * np.linspace(0.0, 1.0, 400)]
    wearer = Wearer(circle[0])
    shoulder = slice(0, 3)
    started, held = wearer.arm.output["angles"][shoulder].copy(), bool(wearer.arm.output["held"].any())
    for there in [*circle, *circle[-1:] * 100]:
        still = wearer.step(there)[2]
    assert bool(wearer.arm.output["held"].any()) == held
    if held:
        assert still
    else:
        np.testing.assert_allclose(wearer.arm.output["angles"][shoulder], started, atol=np.deg2rad(1.0))
