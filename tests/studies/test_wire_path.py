"""The wire-path study: its persons, its set-up, how its figures are read, and short trials."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from helpers.study import cell

from srl.runtime.profile import profile
from srl.sim.parts.person.practice import practised
from srl.studies.superman import wire_path, wire_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import COUNT, drawn, persons
from srl.studies.superman.user_study import tasks
from srl.studies.tasks.task import flat, function
from srl.studies.toolkit.trials import Trial

A = assumed("wire-path")
TEXT = profile.find(wire_trial.PROFILE)[1]
STRAIGHT = replace(persons()[0], bias_x=0.0, bias_y=0.0, tilt_x=0.0, tilt_y=0.0)


def test_the_persons_are_those_drawn_from_the_stated_distributions():
    everyone = persons()
    assert everyone == drawn()
    assert len({p.name for p in everyone}) == COUNT == 50
    assert 1.66 < np.mean([p.height for p in everyone]) < 1.78  # 172.0 (10.1) cm in the paper
    assert everyone[0].options(overhead=True)["strength"] < everyone[0].options()["strength"]
    assert 0.3 < np.mean([p.knowledge for p in everyone]) < 0.7
    for options in (p.options() for p in everyone):
        assert options["knowledge"] > 0.35  # after practice
        assert np.hypot(*options["aim_bias"][:2]) < 0.012


def test_practice_teaches_what_the_two_processes_can_learn():
    assert practised(0.4, 0) == 0.4
    assert practised(0.0, 1) == pytest.approx(0.21 + 0.02)
    assert practised(0.0, 5) < practised(0.0, 50) < practised(0.0, 500) < 1.0
    assert practised(1.0, 5) == pytest.approx(1.0, abs=0.05)


def test_the_ring_starts_before_the_wire_alike_in_both_conditions():
    places = []
    for condition in ("HR", "H"):
        world = cell(wire_trial.setup(TEXT, STRAIGHT, condition, A))
        ring, site = world.data.body("ring/ring"), world.data.site
        start, then = site("wire/path_0").xpos, site("wire/path_1").xpos
        along = ring.xmat.reshape(3, 3)[:, 0]
        assert along @ (then - start) / np.linalg.norm(then - start) == pytest.approx(1.0, abs=0.02)
        assert np.linalg.norm(ring.xpos - start) == pytest.approx(0.07, abs=0.002)
        assert not world.truth_arrays["wire_touches"].any()
        places.append(ring.xpos.copy())
    np.testing.assert_allclose(places[0], places[1], atol=1e-3)


@pytest.mark.parametrize("condition", ["HR", "H"])
def test_who_takes_what_is_tilted_for_upright_holds_the_ring_so(condition: str):
    tilted = replace(STRAIGHT, tilt_x=0.05, tilt_y=-0.02)
    turns = [
        cell(wire_trial.setup(TEXT, who, condition, A)).data.body("ring/ring").xmat.reshape(3, 3).copy()
        for who in (STRAIGHT, tilted)
    ]
    angle = np.arccos((np.trace(turns[1] @ turns[0].T) - 1.0) / 2.0)
    assert angle == pytest.approx(np.hypot(0.05, 0.02), rel=1e-3)


class Faked:
    """A run's truth by hand: 0.1 s a row; 20 s on the way, 10 s at each of two marks, then the rest."""

    def __init__(self, first: int, touched: tuple[float, ...], marks: tuple[float, ...]) -> None:
        path = wire_trial.path(A)
        turn = wire_trial.normalised(A["wire_quaternion"])
        at = [np.array(wire_trial.turned(turn, path.at(m * path.length)[:3])) + A["wire"] for m in marks]
        aim = [np.array([0.0, 0.0, 0.01 * k]) for k in range(200)]
        for place in at:
            aim += [place] * 101 + [place + np.array([0, 0, 0.001 * k]) for k in range(1, 100)]
        n = len(aim)
        self.t = 0.1 * np.arange(n)
        count = np.sum([self.t >= s for s in touched], axis=0) if touched else np.zeros(n)
        self.truth = {
            "world.person_aim": np.array(aim),
            "world.person_tool": np.array(aim) + np.array([0.003, 0.0, 0.004]),
            "world.person_progress": np.column_stack([np.full(n, first), np.zeros(n), np.zeros(n)]),
            "world.person_activation": np.full((n, 4), 0.25),
            "world.wire_touches": np.column_stack([count, np.zeros(n), 0.01 * count]),
        }

    def value(self, name: str) -> Any:
        return self.truth[name]


def test_touches_and_time_count_between_the_wires_beginning_and_the_return():
    run = Faked(1, (5.0, 22.0, 42.0), (0.25, 0.5))
    run.truth["world.person_progress"][:100, 0] = 0  # the first touch is on the way to the wire
    found = wire_trial.read(run, "H", A | {"marks": [0.5], "pause": 10.0})  # type: ignore[arg-type]
    assert found["N_err"] == 2.0
    assert found["T"] == pytest.approx(49.9)
    assert found["moving"] == pytest.approx(29.9)
    assert found["off_mm"] == pytest.approx(5.0)
    assert found["AD"] == 25.0


def trials(errors: dict[str, tuple[float, ...]]) -> list[Trial]:
    metrics = {"off_mm": 1.0, "missed": 0.0, "finished": 1.0, "AD": 1.0, "PD": 2.0, "BC": 3.0, "TR": 4.0}
    own = [
        (condition, k, e, 130.0 + k + (30 if condition == "HR" else 0))
        for condition, all_of in errors.items()
        for k, e in enumerate(all_of)
    ]
    return [
        Trial(f"P{k + 1:02}", condition, metrics | {"N_err": e, "T": t, "moving": t - 60.0}, f"{k}")
        for condition, k, e, t in own
    ]


@pytest.mark.slow
def test_a_claim_that_doesnt_hold_is_reported_so(tmp_path):
    result = wire_path.result(trials({"HR": (2, 1, 3), "H": (0, 1, 1)}), tmp_path)
    held = {claim.id: (claim.holds, claim.measured) for claim in result.claims}
    assert held["robot-fewer-errors"] == (False, pytest.approx(4 / 3))
    assert held["robot-slower"] == (True, pytest.approx(30.0))
    assert "1.42 (1.41 to 1.44) times as long (paper: 1.74" in result.claims[1].text
    assert [row["subject"] for row in result.table][:4] == ["P01", "P02", "P03", "mean (sd)"]
    assert len({tuple(row) for row in result.table}) == 1
    for file in result.files:
        assert (tmp_path / file).stat().st_size > 5000


@pytest.mark.slow
def test_an_interval_that_crosses_zero_is_no_difference(tmp_path):
    result = wire_path.result(trials({"HR": (0, 1, 0), "H": (1, 0, 1)}), tmp_path)
    fewer = result.claims[0]
    assert fewer.measured == pytest.approx(-1 / 3)
    assert not fewer.holds


@pytest.mark.slow
def test_who_didnt_finish_has_no_time_but_touches(tmp_path):
    found = trials({"HR": (2, 1, 9), "H": (3, 2, 9)})
    stopped = replace(found[2], values={**found[2].values, "finished": 0.0})
    result = wire_path.result([*found[:2], stopped, *found[3:]], tmp_path)
    assert "without P03" in result.claims[1].text
    assert "of 3 persons" in result.claims[0].text
    assert "P03" not in [row["subject"] for row in result.table]


def test_no_step_presses_a_button_without_a_robot():
    for condition, first in (("H", "go_to"), ("HR", "press")):
        setup = wire_trial.setup(TEXT, persons()[0], condition, A)
        plan = setup.changes["sim"]["parts"]["person"]["plan"]
        assert plan[0]["do"] == first
        assert [s["button"] for s in plan if s["do"] == "press"] == (["A", "M", "M", "A"] if first == "press" else [])


def test_a_trial_is_a_function_of_its_arguments_that_tasks_find():
    asked = tasks(wire_trial.STUDY, wire_path.TRIAL, {"HR": "moca-man", "H": "moca-man"}, persons(2))
    assert [(t.seed, t.parameters["condition"]) for t in asked] == [(1, "H"), (2, "H"), (1, "HR"), (2, "HR")]
    assert function(wire_path.TRIAL) is wire_trial.trial
    assert asked[0].parameters["person"] == asdict(persons()[0])


@pytest.mark.slow
def test_a_person_leads_the_ring_along_the_wire_alone():
    given = {"person": asdict(persons()[2]), "condition": "H", "changed": {"marks": []}}
    found = [flat(wire_trial.trial(TEXT, given, 3)) for _ in range(2)]
    assert found[0] == found[1]
    assert found[0]["finished"] == 1.0
    assert found[0]["missed"] == 0.0
    fastest = 0.024 / persons()[2].steering
    assert 2 * wire_trial.path(A).length / fastest < found[0]["T"] < 150
