"""Fingertips from landmarks: however the hand is turned, shifted and sized in the picture, and what is no hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from srl.control.hand.hand_kinematics import HandKinematics, HandKinematicsConfig
from srl.control.hand.hand_landmarks import PALM, HandLandmarks, HandLandmarksConfig
from srl.runtime.ipc.header import State
from srl.runtime.models.human_hand import RANGES
from srl.runtime.models.models import HandModel
from srl.testing import Lab, bound

Array = NDArray[np.float64]
RIGHT, LEFT = HandModel(), HandModel(side="left", length=0.17)


def law(hand: HandModel = RIGHT, **options: Any) -> HandLandmarks:
    made = bound(HandLandmarks("hand", HandLandmarksConfig.model_validate({"hand": hand} | options)))
    made.input["landmarks"].fill(np.nan)
    made.reset()
    return made


def points(hand: HandModel, share: float) -> Array:
    """(21, 3) of a posture, by the glove's law: an independent way from angles to points."""
    kinematics = bound(HandKinematics("glove", HandKinematicsConfig.model_validate({"hand": hand})))
    q = RANGES[:, 0] + share * (RANGES[:, 1] - RANGES[:, 0])
    kinematics.input["angles"][:] = np.linalg.pinv(kinematics._M) @ q
    kinematics.reset()
    return np.array(kinematics.output["skeleton"])


unit = st.floats(-1.0, 1.0)


@given(
    turn=st.tuples(unit, unit, unit), size=st.floats(0.51, 1.99), shift=st.tuples(unit, unit, unit),
    share=st.floats(0.0, 1.0), hand=st.sampled_from([RIGHT, LEFT]),
)  # fmt: skip
def test_turn_shift_and_size_make_no_difference(
    turn: Any, size: float, shift: Any, share: float, hand: HandModel
) -> None:
    own = points(hand, share)
    made = law(hand)
    made.input["landmarks"][:] = size * own @ Rotation.from_rotvec(3.0 * np.array(turn)).as_matrix().T + shift
    made.update(0.01)
    np.testing.assert_allclose(made.output["tips"], own[4::4], atol=1e-9)
    np.testing.assert_allclose(made.output["skeleton"], own, atol=1e-9)
    assert made.output["size"][0] == pytest.approx(size)
    assert made.output["off"][0] == pytest.approx(0.0, abs=1e-9)


def test_noise_of_a_landmark_moves_a_tip_by_as_much() -> None:
    rng = np.random.default_rng(1)
    own, made, errors = points(RIGHT, 0.6), law(), []
    for _ in range(300):
        made.input["landmarks"][:] = own + rng.normal(0.0, 0.002, (21, 3))
        made.update(0.01)
        errors.append(np.linalg.norm(made.output["tips"] - own[4::4], axis=1))
    assert 0.003 < np.mean(errors) < 0.006  # m; 2 mm in each coordinate are 3.2 mm


def test_a_mirrored_picture_of_a_closed_hand_is_no_hand() -> None:
    """The palm is flat and fits its mirror image; the fingers would be behind the hand."""
    own, made = points(RIGHT, 0.6), law(RIGHT)
    made.input["landmarks"][:] = own * [-1.0, 1.0, 1.0]
    made.update(0.01)
    assert np.isnan(made.output["tips"]).all()
    made.input["landmarks"][:] = own
    made.update(0.01)
    assert np.isfinite(made.output["tips"]).all()


def test_a_hand_that_turns_round_in_one_picture_is_waited_for() -> None:
    own, made = points(RIGHT, 0.4), law()
    made.input["landmarks"][:] = own
    made.update(0.01)
    made.input["landmarks"][:] = own @ Rotation.from_euler("y", 70, degrees=True).as_matrix().T
    for _ in range(31):
        made.update(0.01)
    assert made.lost
    made.input["landmarks"][:] = own @ Rotation.from_euler("y", 50, degrees=True).as_matrix().T
    made.update(0.01)
    assert not made.lost


@pytest.mark.parametrize("wrong", ["nan", "squashed", "one point", "mirrored palm", "far tip", "too large"])
def test_what_is_no_palm_is_waited_for_then_lost(wrong: str) -> None:
    own, made = points(RIGHT, 0.5), law()
    made.input["landmarks"][:] = own
    made.update(0.01)
    before = made.output["tips"].copy()
    bad = own.copy()
    if wrong == "nan":
        bad[7] = np.nan
    elif wrong == "squashed":
        bad[:] = 0.3
    elif wrong == "one point":
        bad[17] += [0.1, 0.1, 0.0]
    elif wrong == "far tip":
        bad[12] = [4.9, 4.9, 4.9]
    elif wrong == "too large":
        bad *= 2.5
    else:
        bad[list(PALM)] = bad[list(PALM)][::-1]
    made.input["landmarks"][:] = bad
    for _ in range(29):
        made.update(0.01)
    assert not made.lost
    np.testing.assert_array_equal(made.output["tips"], before)
    made.update(0.02)
    assert made.lost
    made.input["landmarks"][:] = own
    made.update(0.01)
    assert not made.lost


def seen(seconds: float, *overrides: str) -> tuple[Lab, Array, NDArray[np.bool_]]:
    """A run with the camera: the lab, the error of each tip (k, 5), m, and in which rows a picture is known.

    The error is against the truth of the time at which the newest picture was taken.
    """
    with Lab("camera-finger", overrides) as lab:
        lab.run(seconds)
    layout, rows = lab.layout, lab.rows
    now, stamp = layout.header(rows, "now"), layout.header(rows, "camera.stamp")
    known = (layout.header(rows, "state") == State.ACTIVE) & (stamp > 0)
    at = np.clip(np.searchsorted(now, stamp + 30_000_000), 0, len(rows) - 1)  # 30 ms: `latency` of the profile
    truth = layout.value(rows, "world.hand_tips")[at]
    return lab, np.linalg.norm(layout.value(rows, "hand.tips") - truth, axis=2), known


def test_a_hand_that_turns_before_the_camera_has_its_tips() -> None:
    lab, error, known = seen(8.0)
    assert known.sum() > 700
    assert np.median(error[known]) < 0.004  # m: 1 mm of noise in each coordinate, and what the hand moves in 10 ms
    assert np.quantile(error[known], 0.99) < 0.02
    age = lab.layout.header(lab.rows, "now") - lab.layout.header(lab.rows, "camera.stamp")
    assert 0.08 < np.median(age[known]) * 1e-9 < 0.12  # s: late, and it says so


def test_a_hand_that_isnt_found_stops_the_finger() -> None:
    lab, _, _ = seen(4.0, "sim.devices.camera.hidden=[[1.5, 10.0]]")
    states = lab.layout.header(lab.rows, "state")
    now = (lab.layout.header(lab.rows, "now") - lab.layout.header(lab.rows[0], "now")) * 1e-9
    stopped = now[states == State.STOPPED]
    assert 1.5 < stopped[0] < 2.2
    assert (states[now > 2.5] == State.STOPPED).all()
