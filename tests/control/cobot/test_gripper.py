"""The gripper: limited speed, from where the hand is, never far ahead of the guard."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound

from srl.control.cobot.gripper import Gripper, GripperConfig

DT = 0.01


def gripper(at: float = 0.0, **options: float) -> Gripper:
    controller = bound(Gripper("gripper", GripperConfig(**options)))
    controller.applied = {"closure": np.array([at])}
    controller.reset()
    return controller


def run(controller: Gripper, closed: bool, cycles: int, moves: bool = True) -> list[float]:
    seen = []
    controller.input["modes"][2] = closed
    for _ in range(cycles):
        controller.update(DT)
        seen.append(controller.output["closure"][0])
        if moves:
            controller.applied["closure"][:] = controller.output["closure"]
    return seen


def test_it_starts_where_the_hand_is() -> None:
    controller = gripper(0.37)
    assert controller.output["closure"][0] == 0.37
    assert controller.output["velocity"][0] == 0.0


def test_it_closes_and_opens_at_the_speed_asked_for() -> None:
    controller = gripper(speed=0.5)
    way = run(controller, True, 100)
    assert way[-1] == pytest.approx(0.5)
    assert np.abs(np.diff([0.0, *way])).max() <= 0.5 * DT + 1e-12
    assert controller.output["velocity"][0] == pytest.approx(0.5)
    assert run(controller, True, 110)[-1] == 1.0
    assert controller.output["velocity"][0] == 0.0
    assert run(controller, False, 210)[-1] == 0.0


def test_ends_are_options() -> None:
    controller = gripper(opened=0.1, closed=0.6)
    assert run(controller, True, 200)[-1] == 0.6
    assert run(controller, False, 200)[-1] == 0.1


def test_a_hand_that_does_not_move_is_not_run_away_from() -> None:
    controller = gripper(0.2)
    assert max(run(controller, True, 300, moves=False)) == pytest.approx(0.3)


def test_a_change_of_mind_turns_at_once_without_a_step() -> None:
    controller = gripper()
    way = run(controller, True, 30) + run(controller, False, 10) + run(controller, True, 10)
    assert np.abs(np.diff(way)).max() <= DT + 1e-12
    assert way[39] < way[29]
