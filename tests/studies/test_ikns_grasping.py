"""The study `ikns-grasping`: real trials, the sense of the null-space motion, and what the analysis makes of rows."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pytest

from srl.control.ikns.record import parse
from srl.runtime.contracts.rotation import conjugate, log, matrix, product
from srl.runtime.models.models import BodyModel
from srl.sim.parts.body import arm_posture
from srl.sim.parts.hand.ycb import YCB
from srl.sim.world.cell import Cell
from srl.studies.ikns import grasping, rig
from srl.studies.ikns.grasp import Task, grasp_trial, wrist
from srl.studies.ikns.grasping_analysis import analysed, counted
from srl.studies.ikns.grasping_trial import OPTIONS, Setting, inwards, trial, turned_round
from srl.studies.ikns.grasping_wearer import KINDS, hand_at, heading
from srl.studies.ikns.tracking import Calibrated
from srl.studies.ikns.wearers import wearers

PROFILE = (resources.files("srl.profiles") / "ikns-finger.yaml").read_text()
SHIPPED = (resources.files("srl.profiles") / "ikns-finger.calibration.json").read_text()
FILE = parse(SHIPPED.encode(), rig.FILE)
CHEST = (0.0, 0.0, 1.1, 1.0, 0.0, 0.0, 0.0)


@cache
def done(condition: str, **changed: Any) -> Any:
    """A trial with the soup can, without an error of reaching."""
    given = {"condition": condition, "object": "D", "set": {}, "calibration": SHIPPED, "aim": 0.0, **changed}
    return trial(PROFILE, given, 1)


def steady(condition: str, code: str) -> Setting:
    """A wearer who moves and takes the object without errors."""
    errors = {f"sim.parts.wearer.{name}": 0.0 for name in ("wander", "wander_turn", "noise", "direction_error")}
    given = {"condition": condition, "object": code, "set": errors, "calibration": SHIPPED, "aim": 0.0}
    return Setting(PROFILE, given, 1)


@pytest.mark.slow
@pytest.mark.parametrize("condition", KINDS)
def test_the_hand_comes_where_it_is_told_with_its_palm_upright(condition: str) -> None:
    made = steady(condition, "A")
    goal = wrist(made.task, YCB["A"], made.task.goal)
    made.grasper.reach(goal, 1.0)
    for _ in range(500):
        made.lockstep.step()
        made.grasper.watch()
        if made.grasper.arrived:
            break
    assert made.grasper.arrived
    world = made.lockstep.graph.world
    assert isinstance(world, Cell)
    found = world.pose_of("hand")
    assert np.linalg.norm(np.subtract(found[:3], goal[:3])) < 0.01
    assert np.linalg.norm(log(product(goal[3:], conjugate(found[3:])))) < 0.03


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("code", "AI")
def test_a_steady_wearer_picks_and_places(code: str) -> None:
    made = steady("ikns", code)
    found = grasp_trial(made.lockstep, made.grasper, made.task, YCB[code], watch=made.grasper.watch)
    assert found.success, found
    assert found.seconds < 12.0


@pytest.mark.slow
def test_out_of_reach_is_out_of_time() -> None:
    made = steady("ikns", "I")
    task = replace(made.task, lift=1.2)
    found = grasp_trial(made.lockstep, made.grasper, task, YCB["I"], watch=made.grasper.watch)
    assert (found.success, found.reason) == (False, "out of time")


@pytest.mark.slow
@pytest.mark.parametrize("condition", KINDS)
def test_a_wearer_picks_and_places_in_both_conditions(condition: str) -> None:
    row = done(condition)
    assert (row["success"], row["reason"]) == (True, "")
    assert 5.0 < row["duration"] < 12.0
    assert row["off"] < 0.05
    assert row["slip"] < 0.05
    assert 0.0 < row["leak"] < 0.04
    assert row["c"] > 0.6
    assert row["closing"] < row["duration"]


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_control_value_is_the_wearers_own() -> None:
    """The same motion with the other sense opens the finger where it should close."""
    row = done("ikns", outwards=True)
    assert not row["success"]
    assert row["reason"] in ("not lifted", "out of time")


@pytest.mark.slow
def test_a_trial_is_a_pure_function() -> None:
    assert dict(done("ring")) == dict(done.__wrapped__("ring"))


def test_the_sense_of_a_calibration_is_known_and_can_be_turned_round() -> None:
    other = turned_round(FILE)
    assert inwards(FILE) != inwards(other)
    assert turned_round(other) == FILE
    for a, b in zip(FILE.points, other.points, strict=True):
        q = np.array(a.directions[0])
        c = (q @ q - a.lower[0]) / (a.upper[0] - a.lower[0])
        turned = (np.array(b.directions[0]) @ q - b.lower[0]) / (b.upper[0] - b.lower[0])
        assert c + turned == pytest.approx(1.0)


@pytest.mark.parametrize("place", [(0.36, -0.24), (0.36, -0.06)])
def test_the_wrist_is_straight_where_the_finger_closes(place: tuple[float, float]) -> None:
    body = BodyModel(kind="body", sides=("right",)).body
    arm = arm_posture.ArmPosture(body, "right")
    task, swivel = Task(place, (9.0, 9.0), table=0.79), 0.1

    def bent(angle: float) -> float:
        own = Task(place, (9.0, 9.0), table=0.79, heading=angle)
        point, turn = hand_at(body, CHEST, wrist(own, YCB["A"], place))
        return abs(float(arm.solve(arm_posture.Hold(np.array(point), matrix(turn)), swivel)[7]))

    found = heading(body, CHEST, task, YCB["A"], place, swivel)
    assert bent(found) < 0.06
    assert bent(found + 0.4) > 0.3


def test_every_wearer_has_every_object_in_both_conditions_with_the_same_errors() -> None:
    orders = []
    for one in (Calibrated(w, SHIPPED, ()) for w in wearers(4)):
        tasks = list(grasping.trials(one, tuple(YCB)))
        seeds = {c: {t.parameters["object"]: t.seed for t in tasks if t.parameters["condition"] == c} for c in KINDS}
        assert seeds["ikns"] == seeds["ring"]
        assert set(seeds["ikns"]) == set(YCB)
        assert len({t.parameters["condition"] for t in tasks[: len(YCB)]}) == 1
        orders.append([t.parameters["object"] for t in tasks])
    assert len({tuple(order) for order in orders}) == 4


def test_a_sweep_changes_one_thing_at_a_time() -> None:
    one = Calibrated(wearers(1)[0], SHIPPED, ())
    plain = grasping.task(one, "ikns", "A").parameters
    changed = [grasping.swept(one, condition, "A", change) for _, condition, change in grasping.changes()]
    assert len({task.identity for task in changed}) == len(changed)
    assert changed[0].parameters == plain
    for task in changed[2:]:
        keys = {k for k in task.parameters if task.parameters[k] != plain.get(k)}
        own = {k for k in plain["set"] if task.parameters["set"][k] != plain["set"][k]}
        assert len(own | (keys - {"set"})) == 1


@pytest.mark.parametrize("name", ["aims", "tracking", "number"])
def test_a_change_of_what_nothing_has_is_refused_by_name(name: str) -> None:
    one = Calibrated(wearers(1)[0], SHIPPED, ())
    known = "aim, clear, servo, thing, skin, outwards, carried"
    with pytest.raises(ValueError, match=rf"has {name}; a trial has {known}$"):
        grasping.task(one, "ikns", "A", aim=0.0, reaction=0.3, **{name: 1.0})


@pytest.mark.slow
@pytest.mark.exhaustive  # eight trials
def test_what_a_trial_may_have_besides_changes_it() -> None:
    """So a name in the list that the trial doesn't read would be noticed."""
    changed: dict[str, Any] = {
        "aim": 0.02, "clear": 0.02, "servo": {"stall_torque": 0.1}, "thing": {"friction": 0.9}, "skin": 0.9,
        "outwards": True, "carried": 1.0,
    }  # fmt: skip
    assert tuple(changed) == OPTIONS
    for name, value in changed.items():
        assert done.__wrapped__("ikns", **{name: value}) != done("ikns"), name


def rows(ikns: list[float], ring: list[float]) -> list[dict[str, Any]]:
    """A row a duration; a negative one failed."""
    return [
        {"wearer": f"W{i:02}", "condition": condition, "object": "I", "duration": abs(s), "success": s > 0.0,
         "reason": "" if s > 0.0 else "dropped"}
        for condition, given in (("ikns", ikns), ("ring", ring))
        for i, s in enumerate(given)
    ]  # fmt: skip


def test_the_sign_test_takes_pairs_that_both_succeeded() -> None:
    claims, table, statistics = analysed(rows([9.0, 8.0, -3.0, 9.5, 7.0, 9.0, 8.5], [6.0, 6.5, 6.0, -2.0, 6.9, 6.0, 6]))
    found = statistics["sign test"]
    assert (found["pairs"], found["ring faster"], found["p"]) == (5, 5, pytest.approx(2 * 0.5**5))
    assert found["median"] == pytest.approx(2.5)
    claim = {c.id: c for c in claims}["ring-faster"]
    assert not claim.holds  # p is 0.0625
    assert table[-1]["ikns success"] == 6
    assert [table[-1][f"{what} paper"] for what in ("ikns", "s", "ring s")] == ["88/100", "8.94", "6.34"]
    assert table[0]["ring failures"] == "dropped 1"


@pytest.mark.parametrize(("slow", "holds"), [(9.0, True), (5.0, False)])
def test_the_ring_is_faster_only_if_it_is(slow: float, holds: bool) -> None:
    claims, _, _ = analysed(rows([slow] * 8, [6.0] * 8))
    assert {c.id: c.holds for c in claims}["ring-faster"] is holds


@pytest.mark.parametrize(("good", "holds"), [(30, True), (10, False)])
def test_the_success_rate_is_judged_by_its_interval(good: int, holds: bool) -> None:
    claims, _, _ = analysed(rows([9.0] * good + [-9.0] * (30 - good), []))
    assert {c.id: c.holds for c in claims} == {"success-rate": holds}


def test_nobody_gives_no_claims() -> None:
    claims, _, statistics = analysed([])
    assert claims == []
    json.dumps(statistics)


def test_failures_are_counted_by_reason() -> None:
    found = counted(rows([9.0, -1.0, -2.0], []))
    assert (found["successes"], found["of"], found["failures"]) == (1, 3, "dropped 2")
    assert found["median s"] == 9.0
