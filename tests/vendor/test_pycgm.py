"""pycgm, an independent Plug-in Gait, against Vicon's own angles, and ours against both. `-s` prints the table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from helpers import mocap
from helpers.mocap import difference, frames
from helpers.shared import shared

from srl.control.ikns.markers import MarkerFit

pytest.importorskip("pyCGM_Single", reason="pip install pycgm")

SUBJECT = "data/vicon_plug_in_gait/Test.vsk"
OUTPUTS = ("RShoulder", "LShoulder", "RElbow", "LElbow", "RWrist", "LWrist")  # rows 13 to 18 of its angles


def pycgm_angles(static: Mapping[str, np.ndarray], moving: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Degrees (frames, 3) by pycgm's names, of a trial after the static one."""
    from pyCGM_Single import pyCGM, pycgmIO, pycgmStatic

    def rows(trial: Mapping[str, np.ndarray]) -> list[dict[str, np.ndarray]]:
        names = [name for name in trial if not name.startswith("*")]
        return [{name: 1e3 * trial[name][i] for name in names} for i in range(len(trial["CLAV"]))]

    subject = pycgmIO.loadVSK(str(shared(SUBJECT)), dict=False)  # which means that it is one
    calibrated = pycgmStatic.getStatic(rows(static), subject, flat_foot=False)
    angles = [np.reshape(pyCGM.JointAngleCalc(row, calibrated)[0], (-1, 3)) for row in rows(moving)]
    return {name: np.array(angles)[:, 13 + i] for i, name in enumerate(OUTPUTS)}


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_ours_theirs_and_vicons() -> None:
    static, moving = mocap.gait("Static"), mocap.gait("Movement")
    theirs = pycgm_angles(static, moving)
    body, _ = mocap.gait_body(static)
    fit = MarkerFit(body)
    everything = np.ones(len(fit.names), bool)
    q: list[np.ndarray] = []
    first = frames(moving, fit.names)[0]
    for _ in range(20):  # until its labels are sure
        fit.solve(first, everything, 1 / 120, starts=6)
    assert not fit.held.any()
    for points in frames(moving, fit.names):
        assert fit.solve(points, everything, 1 / 120, starts=6)
        q.append(fit.angles.copy())
    angles = np.array(q)
    print("\njoint, column: ours - pycgm, degrees rms, max, rms about its mean; the motion's range; pycgm - Vicon, max")
    for side, letter in (("left", "L"), ("right", "R")):
        ours = mocap.vicon_angles(*mocap.as_vicon(body, angles, side))
        chain = {n: np.rad2deg(angles[:, body.names.index(f"{side}_{n}")]) for n in mocap.CHAIN}
        for joint in ("Shoulder", "Elbow", "Wrist"):
            pycgm, vicon = theirs[letter + joint], moving[f"{letter}{joint}Angles"]
            assert np.abs(difference(pycgm, vicon)).max() < 2e-5
            same = mocap.printed(ours[joint.lower()], joint.lower(), side)
            for i in range(1 if joint == "Elbow" else 3):
                off = difference(same[:, i], pycgm[:, i])
                moved = np.ptp(np.unwrap(pycgm[:, i], period=360.0))
                row = (np.sqrt((off**2).mean()), np.abs(off).max(), off.std(), moved, np.abs(pycgm - vicon)[:, i].max())
                print(f"{side} {joint} {i + 1}: {row[0]:.1f} {row[1]:.1f} {row[2]:.1f} {row[3]:.0f} {row[4]:.0e}")
                assert row[0] < 8.0
                assert row[2] < 2.5
        for i, name in enumerate(mocap.CHAIN):
            joint, column = ("Shoulder", i) if i < 3 else ("Elbow", 0)
            off = difference(chain[name], theirs[letter + joint][:, column])
            print(f"{side} chain's own {name}: {np.sqrt((off**2).mean()):.1f} {np.abs(off).max():.1f} {off.std():.1f}")
            assert np.sqrt((off**2).mean()) < 17.0  # less the clavicle's part, which Vicon counts to the shoulder
