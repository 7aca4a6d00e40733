"""Tolerances by ros2_control's rules: 0 says nothing, -1 none, and what nobody measures can't be asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.errors import RequestError
from srl.runtime.ros2.tolerances import STOPPED, Tolerances, exceeded

NAMES = ("proximal", "distal")


def goal(path: list[dict[str, Any]] | None = None, at_end: list[dict[str, Any]] | None = None, **more: Any) -> Any:
    return {
        "multi_dof_trajectory": {"points": []}, "path_tolerance": path or [], "component_path_tolerance": [],
        "goal_tolerance": at_end or [], "component_goal_tolerance": [], "goal_time_tolerance": {"sec": 0, "nanosec": 0},
    } | more  # fmt: skip


def tolerance(name: str, position: float = 0.0, velocity: float = 0.0, acceleration: float = 0.0) -> dict[str, Any]:
    return {"name": name, "position": position, "velocity": velocity, "acceleration": acceleration}


def read(given: Any, measured: tuple[bool, bool] = (True, True)) -> Tolerances:
    return Tolerances.read(given, NAMES, measured, "goal")


def test_what_is_not_said_is_no_bound() -> None:
    made = read(goal([tolerance("distal", 0.1), tolerance("proximal", -1.0)], [tolerance("proximal", velocity=0.2)]))
    np.testing.assert_array_equal(made.path, [[np.inf, 0.1], [np.inf, np.inf]])
    np.testing.assert_array_equal(made.goal, [[np.inf, np.inf], [0.2, STOPPED]])
    assert read(goal(), measured=(True, False)).goal[1, 0] == np.inf
    assert read(goal(at_end=[tolerance("distal", velocity=-1.0)])).goal[1, 1] == np.inf
    assert made.time == np.inf
    assert read(goal(goal_time_tolerance={"sec": 1, "nanosec": 500_000_000})).time == 1.5
    assert read(goal(goal_time_tolerance={"sec": -1, "nanosec": 0})).time == np.inf


@pytest.mark.parametrize(
    ("given", "measured", "problem"),
    [
        (goal([tolerance("thumb", 0.1)]), (True, True), "none of the joints"),
        (goal([tolerance("distal", -0.5)]), (True, True), "position -0.5"),
        (goal([tolerance("distal", float("nan"))]), (True, True), "position nan"),
        (goal(at_end=[tolerance("distal", float("inf"))]), (True, True), "position inf"),
        (goal([tolerance("distal", 0.1)]), (False, False), "doesn't measure the position"),
        (goal([tolerance("distal", 0.1, 0.1)]), (True, False), "doesn't measure the velocity"),
        (goal([tolerance("distal", acceleration=0.1)]), (True, True), "accelerations"),
        (goal([tolerance("distal", acceleration=float("nan"))]), (True, True), "accelerations"),
        (goal(multi_dof_trajectory={"points": [{}]}), (True, True), "several degrees"),
        (goal(goal_time_tolerance={"sec": -2, "nanosec": 0}), (True, True), "negative"),
    ],
)
def test_what_cannot_be_judged_is_refused(given: Any, measured: tuple[bool, bool], problem: str) -> None:
    with pytest.raises(RequestError, match=problem):
        read(given, measured)


def test_a_joint_beyond_its_bound_is_named_and_one_that_is_lost_is_beyond() -> None:
    bounds = np.array([[0.1, np.inf], [np.inf, np.inf]])
    assert exceeded(bounds, np.array([[0.1, 9.0], [9.0, 9.0]]), NAMES) == ""
    assert "'proximal' is off by -0.2 in position" in exceeded(bounds, np.array([[-0.2, 0.0], [0.0, 0.0]]), NAMES)
    assert "'proximal'" in exceeded(bounds, np.array([[np.nan, 0.0], [0.0, 0.0]]), NAMES)
