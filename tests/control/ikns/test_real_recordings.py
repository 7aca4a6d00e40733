"""Recordings of real people: none held a hand still at ten points, so all are refused as calibrations; and a limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import mocap
from helpers.mocap import frames

from srl.control.ikns.calibration import CalibrationError, Recording, calibrate, refusals
from srl.control.ikns.identify import Measures, identify, plug_in_gait
from srl.control.ikns.markers import MarkerFit
from srl.runtime.models.body import Body, Marker, average


def recording(body: Body, markers: dict[str, np.ndarray], rate: float) -> Recording:
    """Angles of the right arm, and the palm's middle in the chest's frame."""
    fit = MarkerFit(body)
    arm = list(body.chains["right_arm"])
    angles, hand = [], []
    for row in frames(markers, fit.names):
        assert fit.solve(row, np.isfinite(row).all(axis=1), 1 / rate, starts=6)
        angles.append(fit.angles[arm])
        palm = fit.pose("right_hand").act(np.array(body.grip("right")))
        hand.append(fit.pose("torso").actInv(palm))
    return Recording(np.arange(len(angles)) / rate, np.array(angles), np.array(hand), np.zeros(len(angles), np.intp))


def walking() -> Recording:
    body, _ = mocap.gait_body(mocap.gait("Static"), "right")
    return recording(body, mocap.gait("Movement"), 120.0)


def lifting() -> Recording:
    markers = mocap.recorded(mocap.LIFTING)
    names = {name: Marker(s, (0.0, 0.0, 0.0)) for s, group in mocap.LIFTER_MARKERS.items() for name in group}
    body, _ = identify(
        replace(average(1.7, ("right",)), markers=names), {n: v[:60] for n, v in markers.items()}, mocap.LIFTER
    )
    return recording(body, markers, 100.0)


@pytest.mark.parametrize("motion", [walking, lifting])
def test_motion_without_a_still_hand_is_refused_with_the_reason(motion: object) -> None:
    assert callable(motion)
    try:
        found = refusals(calibrate(motion()))
    except CalibrationError as error:
        found = (error,)
    output = "\n".join(f"{reason.place}: {reason.problem}. {reason.remedy}" for reason in found)
    print(f"\n{output}")
    assert found
    assert any("kept:" in reason.problem or "no sample" in reason.problem for reason in found)
    assert all(reason.remedy for reason in found)


def test_a_serve_is_beyond_it() -> None:
    """Tennis at 50 Hz, the hand up to 15 m/s, with and without drop-outs of the shoulder's marker (13 % of frames)."""
    whole, gaps = (mocap.recorded(f"{mocap.SERVE}{which}.c3d", unit=1.0) for which in ("", "_nan"))
    marks = plug_in_gait({"right": Measures()})
    body, _ = identify(average(1.75, ("right",)), {n: v[300:360] for n, v in whole.items()}, marks)
    hands, angles = [], []
    for markers in (whole, gaps):
        found = recording(body, markers, 50.0)  # every frame is fitted
        hands.append(found.hand)
        angles.append(found.angles)
    off = np.linalg.norm(hands[1] - hands[0], axis=1)
    apart = np.rad2deg(np.abs(angles[1] - angles[0]))
    print(f"\nhand off by {off.max():.2f} m at most, {np.sqrt((off**2).mean()):.3f} rms; angles by {apart.max():.0f}")
    assert 0.05 < off.max() < 0.6
    assert np.isfinite(apart).all()
