"""Which of the angles of a posture are taken: those of the joints' ranges."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mocap import made
from hypothesis import given
from hypothesis import strategies as st

from srl.control.ikns.markers import MarkerFit
from srl.control.ikns.postures import Postures
from srl.runtime.models.body import average

ARM = average(1.75, ("right",))
POSTURES = Postures(ARM)
SHOULDER = list(ARM.chains["right_arm"][:3])
BOUND = [i for i, name in enumerate(ARM.names) if i >= 3 and name != "torso_yaw"]
SEEN = np.ones(len(ARM.markers), bool)
DT = 0.01

shares = st.lists(st.floats(0.01, 0.99), min_size=len(BOUND), max_size=len(BOUND))
turns = st.lists(st.integers(-2, 2), min_size=len(BOUND), max_size=len(BOUND))


def inside(share: list[float]) -> np.ndarray:
    low, high = ARM.ranges[BOUND].T
    q = np.zeros(len(ARM.joints))
    q[BOUND] = low + np.array(share) * (high - low)
    return q


@given(shares, turns, st.booleans())
def test_angles_that_mean_the_same_posture_come_home(share: list[float], whole: list[int], other: bool) -> None:
    q = inside(share)
    away = q.copy()
    if other:
        a, b, c = q[SHOULDER]
        away[SHOULDER] = a + np.pi, np.pi - b, c + np.pi
    away[BOUND] += 2 * np.pi * np.array(whole)
    np.testing.assert_allclose(made(ARM, away), made(ARM, q), atol=1e-9)
    np.testing.assert_allclose(POSTURES.home(away, q), q, atol=1e-9)


@given(shares, st.floats(-0.3, 0.3))
def test_angles_within_their_ranges_or_a_little_beyond_stay(share: list[float], beyond: float) -> None:
    q = inside(share)
    np.testing.assert_array_equal(POSTURES.returned(q), q)
    q[SHOULDER] = np.clip(q[SHOULDER] + beyond, *(ARM.ranges[SHOULDER] + [[-0.3, 0.3]]).T)
    np.testing.assert_array_equal(POSTURES.returned(q), q)


@pytest.mark.slow
@given(st.lists(st.floats(-12.0, 12.0), min_size=len(ARM.joints), max_size=len(ARM.joints)))
def test_what_returns_is_the_same_posture_and_stays_there(q: list[float]) -> None:
    found = POSTURES.returned(np.array(q))
    np.testing.assert_allclose(made(ARM, found), made(ARM, np.array(q)), atol=1e-8)
    np.testing.assert_array_equal(POSTURES.returned(found), found)
    assert POSTURES.excess(found).sum() <= POSTURES.excess(np.array(q)).sum() + 1e-9
    assert found[ARM.names.index("torso_yaw")] == q[ARM.names.index("torso_yaw")]  # a person may turn on


@given(st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3), st.booleans())
def test_where_both_readings_of_a_shoulder_stay_it_is_ambiguous(abc: list[float], near: bool) -> None:
    """Within the ranges anywhere; near straight forward also beyond them."""
    q = np.zeros(len(ARM.joints))
    q[SHOULDER] = np.clip(abc, *ARM.ranges[SHOULDER].T)
    if near:
        q[SHOULDER] = abc[0], np.pi / 2 + abc[1] / 4.0 * np.deg2rad(19.9), abc[2]
    other = q.copy()
    other[SHOULDER] = q[SHOULDER[0]] + np.pi, np.pi - q[SHOULDER[1]], q[SHOULDER[2]] + np.pi
    one, two = POSTURES.returned(q), POSTURES.returned(POSTURES.home(other, other))
    two_, one_ = POSTURES.returned(other), POSTURES.returned(POSTURES.home(q, q))
    for a, b in ((one, two), (one_, two_), (one, two_)):
        if not np.allclose(np.cos(a - b), 1.0):
            assert POSTURES.ambiguous(a)[SHOULDER].all()
            assert POSTURES.ambiguous(b)[SHOULDER].all()


def test_an_arm_straight_forward_is_ambiguous_only_where_it_is_turned() -> None:
    q = np.zeros(len(ARM.joints))
    for abduction, flexion, rotation, either in (
        (0, 85, 0, False),
        (0, 69, 90, False),
        (90, 85, 0, False),
        (0, 85, 90, True),
        (110, 100, -60, True),
        (-10, -80, 60, True),
    ):
        q[SHOULDER] = np.deg2rad([abduction, flexion, rotation])
        expected = np.isin(np.arange(len(q)), SHOULDER) & either
        np.testing.assert_array_equal(POSTURES.ambiguous(q), expected, (abduction, flexion, rotation))


def ordinary(count: int) -> np.ndarray:
    """(count, n): postures of every day."""
    rng = np.random.default_rng(7)
    low, high = np.deg2rad([(-20, 90), (-30, 75), (-60, 60), (10, 130), (-70, 70), (-50, 50), (-20, 25)]).T
    q = np.zeros((count, len(ARM.joints)))
    q[:, list(ARM.chains["right_arm"])] = rng.uniform(low, high, (count, 7))
    return q


@pytest.mark.parametrize("starts", [1, 6])
def test_a_posture_of_every_day_isnt_taken_for_its_mirrored_one(starts: int) -> None:
    fit, rng = MarkerFit(ARM), np.random.default_rng(8)
    # This one was once found with the wrist turned over.
    special = np.zeros(len(ARM.joints))
    special[list(ARM.chains["right_arm"])] = np.deg2rad([24, 67, 50, 112, -13, 40, -17])
    for q in (special, *ordinary(60)):
        fit.reset()
        points = made(ARM, q)
        for _ in range(2 * 6 // starts):
            fit.solve(points + rng.normal(0.0, 5e-4, points.shape), SEEN, DT, starts)
        assert fit.known
        assert np.rad2deg(np.abs(fit.q - q)[3:]).max() < 15.0
        assert POSTURES.excess(fit.q).max() < np.deg2rad(15.0)
