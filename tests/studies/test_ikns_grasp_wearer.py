"""Grasps by the simulated wearer's own arm."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.contracts.rotation import conjugate, log, product
from sim.parts.hand.ycb import YCB
from sim.world.cell import Cell
from studies.ikns.grasp import Grasp, grasp_trial, wrist
from studies.ikns.grasp_wearer import GOAL, wearer_cell

STEADY = {"wander": 0.0, "wander_turn": 0.0, "noise": 0.0, "direction_error": 0.0}


def trial(code: str, **options: object) -> Grasp:
    lockstep, who, task = wearer_cell(code, **options)  # type: ignore[arg-type]
    return grasp_trial(lockstep, who, task, YCB[code], watch=who.watch)


def test_the_hand_comes_where_it_is_told_with_its_palm_upright() -> None:
    lockstep, who, task = wearer_cell("A", wearer=STEADY)
    goal = wrist(task, YCB["A"], GOAL)
    who.reach(goal, 1.0)
    for _ in range(500):
        lockstep.step()
        who.watch()
        if who.arrived:
            break
    assert who.arrived
    assert isinstance(lockstep.graph.world, Cell)
    found = lockstep.graph.world.pose_of("hand")
    assert np.linalg.norm(np.subtract(found[:3], goal[:3])) < 0.01
    assert np.linalg.norm(log(product(goal[3:], conjugate(found[3:])))) < 0.03


@pytest.mark.parametrize("code", "AI")
def test_a_steady_wearer_picks_and_places(code: str) -> None:
    found = trial(code, wearer=STEADY)
    assert found.success, found
    assert found.seconds < 12.0


def test_out_of_reach_is_out_of_time() -> None:
    found = trial("I", wearer=STEADY, lift=1.2)
    assert not found.success
