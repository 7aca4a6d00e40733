"""Grasps with the worn finger, from the control value through law, guard and servos to contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from srl.runtime.loop.lockstep import Lockstep
from srl.sim.parts.hand.robotic_finger import RoboticFingerPart
from srl.sim.parts.hand.ycb import YCB
from srl.sim.world.cell import Cell
from srl.studies.ikns.grasp import Carried, Task, grasp_trial, wrist
from srl.studies.ikns.grasp_cell import GOAL, SERVO, START, carried_cell
from srl.studies.ikns.grasp_table import WEAK, one


def world_of(lockstep: Lockstep) -> Cell:
    assert isinstance(lockstep.graph.world, Cell)
    return lockstep.graph.world


def run(lockstep: Lockstep, who: Carried, seconds: float) -> None:
    for _ in range(round(seconds / 0.01)):
        lockstep.step()
        who.watch()


def held(code: str, **options: Any) -> tuple[Lockstep, Carried, Task]:
    """The cell with the object between finger and palm, still on the table."""
    lockstep, who, task = carried_cell(code, **options)
    for aside in (0.15, 0.0):
        who.reach(wrist(task, YCB[code], START, aside=aside), 0.8)
        run(lockstep, who, 0.9)
    who.squeeze(1.0)
    run(lockstep, who, 1.4)
    return lockstep, who, task


@pytest.mark.parametrize(
    "code", [code if i % 3 == 0 else pytest.param(code, marks=pytest.mark.slow) for i, code in enumerate(YCB)]
)
def test_an_ideal_hand_picks_and_places_every_object(code: str) -> None:
    found = one(code)
    assert found.success, found
    assert found.reason == ""
    assert found.seconds < 8.0
    assert found.slip < 0.015
    assert found.tilt < 0.02
    assert found.off < 0.02
    assert 1.0 < found.force < 30.0


@pytest.mark.slow
@pytest.mark.parametrize("code", "AI")
def test_ample_friction_holds_in_the_air_and_none_drops(code: str) -> None:
    """Held still in the air for two seconds. The same grasp on ice stays on the table."""
    for friction, stays in ((1.0, True), (0.01, False)):
        lockstep, who, task = held(code, thing={"friction": friction}, hand={"friction": friction})
        who.reach(wrist(task, YCB[code], START, up=0.1), 0.8)
        run(lockstep, who, 0.9)
        first = float(world_of(lockstep).truth_arrays["thing_pose"][2])
        run(lockstep, who, 2.0)
        last = float(world_of(lockstep).truth_arrays["thing_pose"][2])
        assert (first > YCB[code].height / 2 + 0.05) == stays
        assert (abs(last - first) < 0.005) or not stays


def test_contact_stops_the_finger_at_its_servos_stall_torque() -> None:
    lockstep, _, _ = held("D")
    truth = world_of(lockstep).truth_arrays
    finger = world_of(lockstep).part(RoboticFingerPart, "finger")
    assert truth["finger_contact"][0] > 1.0
    assert (truth["finger_position"] < finger.servo_targets() - 0.1)[1:3].any()  # it doesn't get where it wants to
    # Dry friction of the gears adds to what the motor gives.
    assert np.abs(truth["finger_effort"]).max() <= SERVO["stall_torque"] * 1.02
    assert np.abs(truth["finger_velocity"]).max() < 0.05


@pytest.mark.slow
def test_the_heaviest_object_needs_the_stronger_servo() -> None:
    """370 g: the standard finger of 0.14 N m doesn't lift it, one of 0.22 N m does. 68 g are light for both."""
    assert one("M", servo=WEAK).reason in ("not lifted", "dropped")
    assert one("I", servo=WEAK).success


def test_too_little_closing_doesnt_lift() -> None:
    assert one("D", squeeze=0.3).reason == "not lifted"


def test_a_finger_that_opens_on_the_way_drops_the_object() -> None:
    lockstep, who, task = carried_cell("I")
    lifted = world_of(lockstep).truth_arrays["thing_pose"]

    def watch() -> None:
        if lifted[2] > 0.12:
            who.squeeze(0.0)
        who.watch()

    found = grasp_trial(lockstep, who, task, YCB["I"], watch=watch)
    assert not found.success
    assert found.reason in ("dropped", "not lifted")


@pytest.mark.slow
def test_a_finger_that_doesnt_open_hasnt_released() -> None:
    lockstep, who, task = carried_cell("I")
    began = False

    def watch() -> None:
        nonlocal began
        began = began or (who.squeezed and lockstep.graph.row.views["client.c"][0] == 1.0)
        if began:
            who.squeeze(1.0)
        who.watch()

    assert grasp_trial(lockstep, who, task, YCB["I"], watch=watch).reason == "not released"


@pytest.mark.slow
def test_a_slow_hand_runs_out_of_time() -> None:
    found = one("I", pace=6.0)
    assert (found.success, found.reason) == (False, "out of time")
    assert found.seconds == pytest.approx(20.0, abs=0.1)


@pytest.mark.slow
def test_an_object_that_is_left_elsewhere_is_off_the_goal() -> None:
    lockstep, who, task = carried_cell("A")
    plain = who.reach
    goal = wrist(task, YCB["A"], GOAL)

    def reach(at: Any, seconds: float) -> None:
        plain((at[0], at[1] - 0.08, *at[2:]) if at == goal else at, seconds)

    who.reach = reach  # type: ignore[method-assign]
    found = grasp_trial(lockstep, who, task, YCB["A"], watch=who.watch)
    assert found.reason == "off the goal"
    assert found.off == pytest.approx(0.08, abs=0.02)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_grasp() -> None:
    assert one("L") == one("L")


def test_a_restored_world_holds_the_object_bit_for_bit() -> None:
    lockstep, _, _ = held("I")
    world = world_of(lockstep)
    state = world.save()
    other = world_of(carried_cell("I")[0])
    other.restore(state)
    until = world.time + 500_000_000
    world.advance(until)
    other.advance(until)
    assert world.save().tobytes() == other.save().tobytes()
