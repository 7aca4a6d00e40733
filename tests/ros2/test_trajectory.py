"""Trajectories are those of ros2_control: through their points, as smooth as they are given, in limits or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from srl.runtime.contracts.errors import RequestError
from srl.runtime.ros2.trajectory import Trajectory

NAMES = ("a", "b")


def point(time: float, q: Any, v: Any = (), a: Any = ()) -> dict[str, Any]:
    whole = round(time * 1e9)
    return {
        "positions": np.array(q, float), "velocities": np.array(v, float), "accelerations": np.array(a, float),
        "effort": np.empty(0), "time_from_start": {"sec": whole // 10**9, "nanosec": whole % 10**9},
    }  # fmt: skip


def made(*points: dict[str, Any], names: Any = NAMES, start: Any = (0.0, 0.0)) -> Trajectory:
    return Trajectory({"joint_names": list(names), "points": list(points)}, NAMES, np.array(start), "here")


numbers = st.floats(-3, 3)
pairs = st.tuples(numbers, numbers)


@given(
    st.lists(st.tuples(st.floats(0.1, 2.0), pairs, pairs, pairs), min_size=1, max_size=4), st.sampled_from([1, 3, 5])
)
def test_it_is_the_spline_of_another_library(steps: list[Any], degree: int) -> None:
    times = np.cumsum([step[0] for step in steps])
    points, knots = [], [[np.zeros(2)] * ((degree + 1) // 2)]
    for i, (time, (_, q, moving, a)) in enumerate(zip(times, steps, strict=True)):
        v = (0.0, 0.0) if i == len(steps) - 1 else moving
        points.append(point(time, q, *((v,) if degree > 1 else ()), *((a,) if degree > 3 else ())))
        knots.append([np.array(x) for x in (q, v, a)][: (degree + 1) // 2])
    ours = made(*points)
    exact = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    theirs = BPoly.from_derivatives([0.0, *exact], knots)
    for time in np.linspace(0.0, ours.end * (1 - 1e-9), 23):
        q, dq = ours.at(float(time))
        np.testing.assert_allclose(q, theirs(time), atol=1e-7)
        np.testing.assert_allclose(dq, theirs.derivative()(time), atol=1e-5)


def test_each_segment_has_the_degree_that_its_two_ends_allow() -> None:
    zero = (0.0, 0.0)
    ours = made(
        point(1.0, (0.2, 0.1), (0.5, 0.2), (0.1, -0.3)),  # a quintic from rest to here
        point(2.0, (0.5, 0.6), (0.3, 0.1)),  # a cubic
        point(3.0, (0.8, 0.9)),  # lines to here, and from here on
        point(4.0, (1.0, 1.0), zero, zero),
    )
    begin, middle = [[zero] * 3, [(0.2, 0.1), (0.5, 0.2), (0.1, -0.3)]], [[(0.2, 0.1), (0.5, 0.2)]]
    expected = [
        BPoly.from_derivatives([0.0, 1.0], [list(map(np.array, knot)) for knot in begin]),
        BPoly.from_derivatives([1.0, 2.0], [list(map(np.array, k)) for k in (*middle, [(0.5, 0.6), (0.3, 0.1)])]),
        BPoly.from_derivatives([2.0, 3.0], [[np.array((0.5, 0.6))], [np.array((0.8, 0.9))]]),
        BPoly.from_derivatives([3.0, 4.0], [[np.array((0.8, 0.9))], [np.array((1.0, 1.0))]]),
    ]
    for time in np.linspace(0.0, 3.99, 57):
        theirs = expected[int(time)]
        np.testing.assert_allclose(ours.at(float(time))[0], theirs(time), atol=1e-12)
        np.testing.assert_allclose(ours.at(float(time))[1], theirs.derivative()(time), atol=1e-9)


def test_a_first_point_at_0_decides_on_the_degree_of_the_first_segment_alone() -> None:
    ours = made(point(0.0, (0.0, 0.0)), point(1.0, (1.0, 0.0), (1.0, 0.0)), point(2.0, (1.0, 0.0), (0.0, 0.0)))
    np.testing.assert_allclose(ours.at(0.25)[0], (0.25, 0.0))  # a line: the first point has no velocity
    np.testing.assert_allclose(ours.at(1.5)[0], (1.125, 0.0))  # a cubic


def test_a_velocity_that_is_0_but_for_rounding_is_at_rest() -> None:
    assert made(point(1.0, (1.0, 1.0), (6e-8, 0.0))).end == 1.0


def test_joints_may_come_in_any_order_and_the_end_is_held() -> None:
    ours = made(point(1.0, (2.0, 1.0)), names=("b", "a"))
    np.testing.assert_allclose(ours.at(0.5)[0], (0.5, 1.0))
    np.testing.assert_allclose(ours.at(9.0)[0], (1.0, 2.0))
    assert not ours.at(9.0)[1].any()


def test_it_begins_where_the_joints_are_whatever_a_first_point_at_0_says() -> None:
    ours = made(point(0.0, (0.32, 0.3), (9.0, 9.0)), point(1.0, (1.0, 1.0), (0.0, 0.0)), start=(0.3, 0.3))
    np.testing.assert_allclose(ours.at(0.0)[0], (0.3, 0.3))
    np.testing.assert_allclose(ours.at(0.0)[1], 0.0)


@pytest.mark.parametrize(
    ("points", "names", "text"),
    [
        ([point(1.0, (1.0, 1.0))], ("a",), "it is for a"),
        ([point(1.0, (1.0, 1.0))], ("a", "a"), "it is for a, a"),
        ([], NAMES, "0 points"),
        ([point(0.0, (0.0, 0.0))], NAMES, "no point after its beginning"),
        ([point(0.0, (0.0, 0.1)), point(1.0, (1.0, 1.0))], NAMES, "begins where the joints aren't"),
        ([point(1.0, (1.0,))], NAMES, "point 1 hasn't 2 positions"),
        ([point(1.0, (1.0, 1.0), (0.0,))], NAMES, "point 1 hasn't"),
        ([point(1.0, (1.0, np.nan))], NAMES, "isn't finite"),
        ([point(1.0, (1.0, 1.0)), point(1.0, (1.0, 1.0))], NAMES, "the time of point 2"),
        ([point(-1.0, (1.0, 1.0))], NAMES, "the time of point 1"),
        ([point(1e5, (1.0, 1.0))], NAMES, "the time of point 1"),
        ([point(1.0, (1.0, 1.0), (0.5, 0.0))], NAMES, "doesn't end at rest"),
        ([point(1.0, (1.0, 1.0)) | {"effort": np.ones(2)}], NAMES, "point 1 has efforts"),
    ],
)
def test_what_cant_be_followed_is_refused(points: list[Any], names: Any, text: str) -> None:
    with pytest.raises(RequestError, match=text):
        made(*points, names=names)


def test_limits_are_looked_at_all_along() -> None:
    limits = np.full(2, -1.0), np.full(2, 1.0), np.full(2, 2.0)
    made(point(1.0, (0.9, -0.9), (0.0, 0.0))).check(*limits, NAMES, "here")
    over = made(point(1.0, (0.9, 0.0), (2.0, 0.0)), point(2.0, (0.9, 0.0), (0.0, 0.0)))
    with pytest.raises(RequestError, match="'a' leaves its position limits"):  # between two points that are within
        over.check(*limits, NAMES, "here")
    with pytest.raises(RequestError, match="'b' leaves its velocity limit"):
        made(point(0.2, (0.0, 0.9), (0.0, 0.0))).check(*limits, NAMES, "here")


def test_joints_that_are_left_out_stay_where_they_are_if_that_is_allowed() -> None:
    message = {"joint_names": ["b"], "points": [point(1.0, [0.5])]}
    with pytest.raises(RequestError, match="Name all of a, b"):
        Trajectory(message, NAMES, np.array([0.3, 0.0]), "here")
    whole = Trajectory(message, NAMES, np.array([0.3, 0.0]), "here", partial=True)
    for time in np.linspace(0.0, 1.0, 5):
        np.testing.assert_allclose(whole.at(time)[0], [0.3, 0.5 * time], atol=1e-12)
    with pytest.raises(RequestError, match="Name some of a, b"):
        Trajectory(message | {"joint_names": ["c"]}, NAMES, np.zeros(2), "here", partial=True)


def test_the_index_is_that_of_the_point_it_goes_to() -> None:
    whole = made(point(1.0, [0, 0]), point(2.0, [1, 1]))
    assert [whole.index(t) for t in (-1.0, 0.5, 1.5, 9.0)] == [0, 0, 1, 1]
