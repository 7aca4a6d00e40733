"""Calibration from recordings of real people: none of them held a hand still at ten points, so all are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import mocap
from helpers.mocap import frames

from runtime.control.ikns.body import Body, Marker, average
from runtime.control.ikns.calibration import CalibrationError, Recording, calibrate, refusals
from runtime.control.ikns.identify import identify
from runtime.control.ikns.markers import MarkerFit


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
    said = "\n".join(f"{reason.place}: {reason.problem}. {reason.remedy}" for reason in found)
    print(f"\n{said}")
    assert found
    assert any("kept:" in reason.problem or "no sample" in reason.problem for reason in found)
    assert all(reason.remedy for reason in found)
