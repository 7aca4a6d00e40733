"""From the glove's sensors to fingertips."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import glove, hand_tips
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import JOINTS, RANGES
from srl.runtime.models.models import HandModel

# The joint each sensor moves at rate one, read off the protocol sheet, section 5 (22 sensors).
MOVES = {
    0: "thumb_tm_flexion", 1: "thumb_mcp_flexion", 2: "thumb_ip_flexion", 3: "thumb_tm_abduction",
    4: "index_mcp_flexion", 5: "index_pip_flexion", 6: "index_dip_flexion",
    7: "middle_mcp_flexion", 8: "middle_pip_flexion", 9: "middle_dip_flexion", 10: "index_mcp_abduction",
    11: "ring_mcp_flexion", 12: "ring_pip_flexion", 13: "ring_dip_flexion",
    15: "little_mcp_flexion", 16: "little_pip_flexion", 17: "little_dip_flexion",
}  # fmt: skip


@pytest.mark.parametrize("sensor", range(22))
def test_each_sensor_moves_its_joint(sensor: int) -> None:
    hand = glove()
    hand.input["angles"][sensor] = 0.1
    hand.reset()
    moved = {j: v for j, v in zip(JOINTS, hand.output["angles"], strict=True) if v}
    if sensor in MOVES:
        expected = {MOVES[sensor]: 0.1}
    elif sensor == 14:  # ring from middle: carries the little finger along
        expected = {"ring_mcp_abduction": -0.1, "little_mcp_abduction": -0.1}
    elif sensor == 18:
        expected = {"little_mcp_abduction": -0.1}
    else:  # palm arch, wrist
        expected = {}
    assert moved == pytest.approx(expected)


def test_eighteen_sensors_are_the_same_without_the_dips() -> None:
    full, short = glove(), glove(18)
    angles = np.linspace(0.05, 0.4, 22)
    angles[[6, 9, 13, 17]] = 2 / 3 * angles[[5, 8, 12, 16]]
    full.input["angles"][:] = angles
    short.input["angles"][:] = np.delete(angles, [6, 9, 13, 17])
    full.reset()
    short.reset()
    np.testing.assert_allclose(short.output["tips"], full.output["tips"], atol=1e-15)


@pytest.mark.slow
@given(arrays(float, 22, elements=st.floats(-10, 10)))
def test_angles_beyond_anatomy_stay_within_the_hand(angles: Array) -> None:
    hand = glove()
    hand.input["angles"][:] = angles
    hand.update(0.01)
    q = hand.output["angles"]
    assert np.all((q >= RANGES[:, 0]) & (q <= RANGES[:, 1]))
    np.testing.assert_allclose(hand.output["tips"], hand_tips(q), atol=1e-15)


def test_readings_beyond_range_are_counted() -> None:
    hand = glove()
    hand.reset()
    assert hand.metrics()["beyond_range"] == 0.0
    hand.input["angles"][4] = -1.5
    hand.update(0.01)
    assert hand.metrics()["beyond_range"] == 0.5


def test_left_hand_mirrors_the_right() -> None:
    right, left = glove(), glove(hand=HandModel(side="left", length=0.2))
    for hand in (right, left):
        hand.input["angles"][:] = np.linspace(0.0, 0.5, 22)
        hand.reset()
    for name in ("tips", "skeleton"):
        expected = right.output[name] * [-1.0, 1.0, 1.0] * 0.2 / 0.189
        np.testing.assert_allclose(left.output[name], expected, atol=1e-15)


def test_skeleton_runs_from_wrist_to_tips() -> None:
    hand = glove()
    hand.input["angles"][:] = 0.3
    hand.reset()
    signal = {s.name: s for s in hand.outputs}["skeleton"]
    points = hand.output["skeleton"]
    assert points.shape == signal.shape
    assert len(signal.labels) == len(points)
    for finger, link in enumerate(signal.links):
        assert link[0] == 0
        np.testing.assert_array_equal(points[link[-1]], hand.output["tips"][finger])
    lengths = np.linalg.norm(np.diff(points[list(signal.links[2])], axis=0), axis=1)
    np.testing.assert_allclose(lengths[1:], [0.040, 0.035, 0.017], atol=1e-12)
    np.testing.assert_array_equal(points[0], 0.0)
