"""The applications: a person's closing hand, the search of starts, the verdicts, and trials in the physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel
from srl.runtime.profile import profile
from srl.studies.grasp import applications, applications_rig, bottle_trial, starts
from srl.studies.grasp.applications_analysis import Asked, compared, records, table, verdicts
from srl.studies.grasp.applications_rig import Rig
from srl.studies.grasp.bottle_trial import TURN, unscrew
from srl.studies.grasp.closing import CLOSINGS
from srl.studies.grasp.closing_person import ClosingPerson
from srl.studies.grasp.door_trial import press
from srl.studies.grasp.lifting_trial import Draw, lift
from srl.studies.tasks.task import Row, TrialTask

TEXT = profile.find(applications.PROFILE)[1]


class StuckHand:
    """A hand whose joints are where the test says."""

    def __init__(self) -> None:
        self.q = np.zeros(20)

    def worn_by(self, wearer: Any) -> None:
        self.wearer = wearer

    def position(self) -> Array:
        return self.q.copy()


def row(scene: str, arm: str, seed: int, reason: str, **values: Any) -> Row:
    task = TrialTask.of("x", "x", seed, {"scene": scene, "arm": arm, "distal": 0.05, "home": [0.0] * 4})
    own = {"success": not reason, "reason": reason, "closing": CLOSINGS[seed % 2], "pushed": 0.01, "slip": 0.001}
    return Row(f"{scene}{arm}{seed}", task, "", "done", own | {"force": 2.0, "root": 0.1} | values, "", 1.0, "", {})


def test_a_person_who_is_stopped_squeezes_with_the_lead_and_no_more() -> None:
    hand = StuckHand()
    person = ClosingPerson(hand, np.zeros(20), 0.12)  # type: ignore[arg-type]
    person.go(np.array([np.zeros(20), np.ones(20)]), 1.0, 2.0)
    np.testing.assert_array_equal(person.target(0.5), 0.0)
    for t in (1.5, 2.0, 3.0, 9.0):
        goal = person.target(t)
        assert (goal <= 0.12 + 1e-12).all()
    np.testing.assert_allclose(goal, 0.12)
    hand.q[:8] = 0.5  # what isn't stopped goes on
    np.testing.assert_allclose(person.target(9.0)[:8], 0.62)
    person.hold(9.0, range(8, 20))
    hand.q[:] = 0.3
    np.testing.assert_allclose(person.target(9.0), np.r_[np.full(8, 0.42), np.full(12, 0.12)])


def test_draws_have_both_closing_laws_evenly_and_stay_in_their_ranges() -> None:
    draws = [Draw.of(seed) for seed in range(100)]
    assert [draw.closing for draw in draws[:4]] == ["curl", "converge", "curl", "converge"]
    sizes = np.array([draw.size for draw in draws])
    assert sizes.min() < -0.9
    assert 0.9 < sizes.max() <= 1.0
    assert all(0.008 <= draw.place[2] <= 0.016 and np.abs(draw.place[:2]).max() <= 0.010 for draw in draws)
    assert Draw.of(3).turn == Draw.of(3).turn != Draw.of(4).turn


def test_the_search_keeps_the_better_pose_and_slip_decides_between_equals(tmp_path: Path) -> None:
    asked: list[tuple[float, int]] = []

    class Pretended:
        def rows(self, tasks: Sequence[TrialTask], folder: Path) -> list[Row]:
            found = []
            for task in tasks:
                distal, seed = task.parameters["distal"], task.seed
                asked.append((distal, seed))
                good = distal > 0.06 or seed == starts.SEEDS
                found.append(row("box", "splint", seed, "" if good else "dropped", slip=distal))
            return found

    poses = [{"distal": distal, "home": [0.0] * 4} for distal in (0.05, 0.09, 0.07)]

    def task(pose: Mapping[str, Any], seed: int) -> TrialTask:
        return TrialTask.of("x", "x", seed, pose)

    best = starts.search(poses, task, Pretended(), tmp_path, ((3, 2), (2, 4)))  # type: ignore[arg-type]
    assert best == {"distal": 0.07, "home": [0.0] * 4, "successes": 6, "of": 6}
    assert {distal for distal, seed in asked if seed >= starts.SEEDS + 2} == {0.07, 0.09}
    assert len(set(asked)) == len(asked)


@pytest.mark.parametrize("scene", [*applications.SCENES, "can"])
def test_every_scene_has_starts_within_the_fingers_range(scene: str) -> None:
    model = FingerModel()
    for arm in ("bare",) if scene == "can" else applications.STUDIED:
        start = applications._start(scene, arm, 7)
        assert 0.03 < start["distal"] < 0.145
        home = np.deg2rad(start["home"])
        assert (np.array(model.lower) <= home).all()
        assert (home <= np.array(model.upper)).all()


@pytest.mark.slow
def test_candidates_are_clear_of_the_object() -> None:
    from srl.studies.grasp.things import Thing

    poses = starts.candidates(Thing("cube", 0.09), 4, 0)
    assert [pose["distal"] for pose in poses] == list(starts.DISTAL)
    assert poses == starts.candidates(Thing("cube", 0.09), 4, 0)


def test_verdicts_are_of_pairs_and_leave_out_what_cant_begin() -> None:
    rows = [row("box", "mapping", seed, "" if seed < 9 else "dropped") for seed in range(12)]
    rows += [row("box", "bare", seed, "" if seed in (0, 9) else "not lifted") for seed in range(12)]
    rows += [row("box", arm, 12, reason) for arm, reason in (("mapping", ""), ("bare", "unusable"))]
    found = records(rows)
    # Only mapping: seeds 1 to 8; only bare: seed 9. The exact binomial of 1 of 9.
    assert compared(found, "box", "mapping", "bare") == {
        "scene": "box", "arm": "mapping", "against": "bare", "pairs": 12, "only": 8, "only against": 1, "p": 20 / 512,
    }  # fmt: skip
    asked = Asked("box", "box", "mapping", "bare", "")
    (verdict,) = verdicts(found, [asked])
    assert verdict.holds
    assert verdict.measured == pytest.approx(100 * 7 / 12)
    assert not verdicts(found, [Asked("box", "box", "bare", "mapping", "")])[0].holds
    # p = 0.039 isn't enough for one of two claims.
    assert not any(one.holds for one in verdicts(found, [asked, asked]))
    lines = {line["arm"]: line for line in table(found)}
    assert (lines["mapping"]["successes"], lines["mapping"]["of"]) == (10, 13)
    # Wilson's interval by its formula.
    n, p, z = 13, 10 / 13, 1.959964
    middle, half = (
        (p + z**2 / (2 * n)) / (1 + z**2 / n),
        z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)),
    )
    assert (lines["mapping"]["low"], lines["mapping"]["high"]) == pytest.approx(
        (middle - half, middle + half), rel=1e-5
    )
    assert (lines["bare"]["of"], lines["bare"]["unusable"]) == (12, 1)
    assert lines["bare"]["failures"] == "not lifted 10"


class StuckCap:
    """A held bottle whose cap a closing hand has turned already, and which stays so."""

    def __init__(self, cap: float) -> None:
        self.time, self.cell = 0.0, self
        self.truth_arrays = {"thing_cap": np.array([cap])}
        self.model, self.data, self.id, self.dofadr, self.dof_frictionloss = self, self, 0, [0], [0.05]
        self.xfrc_applied, self.xmat = np.zeros((1, 6)), np.eye(3).reshape(1, 9)

    def body(self, name: str) -> StuckCap:
        return self

    joint = body

    def inside(self) -> Array:
        return np.zeros(3)

    def turn(self) -> tuple[float, ...]:
        return (1.0, 0.0, 0.0, 0.0)

    def run(self, seconds: float) -> None:
        self.time += seconds


@pytest.mark.parametrize("before", [-3.5, 0.0, 3.5])
def test_what_a_closing_hand_turned_of_the_cap_isnt_unscrewed(before: float) -> None:
    row: dict[str, Any] = {"slip": 0.0}
    reason = bottle_trial._turn(StuckCap(before), 0.075, row)  # type: ignore[arg-type]
    assert (reason, row["cap"], row["strokes"]) == ("not turned", 0.0, 4)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", [0, 5])
def test_the_bare_hand_holds_what_every_hand_holds(seed: int) -> None:
    found = lift(TEXT, {"scene": "can", "arm": "bare", **starts.found("can", "bare")}, seed)
    assert found["success"], found


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_box_too_large_for_the_hand_is_lifted_with_the_finger_alone() -> None:
    bare, held = (
        lift(TEXT, {"scene": "box", "arm": arm, **starts.found("box", arm)}, 5) for arm in ("bare", "concentric")
    )
    assert bare["reason"] == "not lifted", bare
    assert bare["force"] == 0.0
    assert held["success"], held
    assert float(held["force"] or 0.0) > 1.0
    assert float(held["root"] or 0.0) <= applications_rig.LEANING


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_what_is_held_doesnt_creep_down_with_the_noslip_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    def sinking(iterations: int) -> float:
        """m/s, over the last seconds of a hold."""
        heights: list[float] = []
        monkeypatch.setattr(applications_rig, "NOSLIP", iterations)

        def watch(rig: Rig) -> None:
            heights.append(float(rig.inside()[2]))

        found = lift(TEXT, {"scene": "can", "arm": "bare", **starts.found("can", "bare"), "hold": 3.0}, 0, watch)
        assert found["success"]
        return (heights[-201] - heights[-1]) / 2.0

    creep, without = sinking(applications_rig.NOSLIP), sinking(0)
    assert abs(creep) < 1.5e-4
    assert without > creep


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_bottle_is_held_while_its_cap_is_turned_and_not_by_three_fingers() -> None:
    start = starts.found("bottle", "concentric")
    held, bare = (unscrew(TEXT, {"scene": "bottle", "arm": arm, **start}, 1) for arm in ("concentric", "bare"))
    assert held["success"], held
    assert float(held["cap"] or 0.0) >= TURN
    assert int(held["strokes"] or 0) == 3
    assert not bare["success"]
    assert bare["cap"] == 0.0


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_full_hand_presses_a_handle_with_the_finger_alone() -> None:
    start = starts.found("door", "mapping")
    found = {arm: press(TEXT, {"scene": "door", "arm": arm, **start}, 0) for arm in ("bare", "mapping")}
    assert found["mapping"]["success"], found["mapping"]
    assert found["bare"]["turn"] == 0.0
