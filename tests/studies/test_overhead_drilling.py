"""The overhead-drilling study: its set-up, how its figures are read, and short trials."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.study import cell, profile

from srl.runtime.profile import profile as profiles
from srl.studies.superman import drilling_trial, overhead_drilling
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import persons
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.runner import Runner
from srl.studies.toolkit.trials import Trial

A = assumed("overhead-drilling")
STRAIGHT = replace(persons()[0], tilt_x=0.0, tilt_y=0.0)


def text(condition: str) -> str:
    return profiles.find(drilling_trial.PROFILES[condition])[1]


def test_the_drill_starts_upright_under_the_first_hole_in_both_conditions():
    tips = []
    for condition in ("HR", "H"):
        world = cell(drilling_trial.setup(text(condition), STRAIGHT, condition, A, 20))
        tip, hole = world.data.site("drill/tip").xpos, world.data.site("plate/hole_0").xpos
        assert world.data.body("drill/drill").xmat.reshape(3, 3)[2, 2] > 0.999
        assert hole[2] == pytest.approx(1.9)
        np.testing.assert_allclose(tip[:2], hole[:2], atol=2e-3)
        assert 0.03 < hole[2] - tip[2] < 0.12
        tips.append(tip.copy())
        assert world.model.body("drill/drill").mass[0] == pytest.approx(5.0)
    np.testing.assert_allclose(tips[0], tips[1], atol=2e-3)


def test_a_tilted_drill_is_told_to_the_robot_as_it_is():
    setup = drilling_trial.setup(text("HR"), replace(STRAIGHT, tilt_x=0.1), "HR", A, 20)
    world, arm = cell(setup), profile(setup)["devices"]["arm"]
    assert world.data.body("drill/drill").xmat.reshape(3, 3)[2, 2] == pytest.approx(math.cos(0.1), abs=1e-3)
    flange = world.model.body("arm/flange").id
    turn, at = world.data.xmat[flange].reshape(3, 3), world.data.xpos[flange]
    centre = turn.T @ (world.data.subtree_com[flange] - at)
    np.testing.assert_allclose(arm["payload_cog"], centre, atol=6e-3)


class Faked:
    """A run's truth by hand: 10 s a hole, 0.1 s a row; `given_up` after so many holes."""

    def __init__(self, dwell: tuple[float, ...], touched: int, given_up: int | None) -> None:
        holes = len(dwell)
        n = 100 * (holes if given_up is None else given_up)
        self.t = 0.1 * np.arange(n)
        step = np.minimum(self.t // 2.5, 4 * holes - 1)
        gave_up = np.zeros(n)
        if given_up is not None:
            step[-1], gave_up[-1] = 4 * holes, 1.0
        else:
            step[-1] = 4 * holes
        self.truth = {
            "world.person_progress": np.column_stack([step, np.zeros(n), gave_up]),
            "world.plate_touches": np.column_stack([np.linspace(0, touched, n).round(), np.zeros(n), np.zeros(n)]),
            "world.plate_dwell": np.tile(dwell, (n, 1)),
            "world.plate_inside": np.zeros((n, 1)),
            "world.person_tool": np.tile([0.003, 0.004, 0.1], (n, 1)),
            "world.person_aim": np.zeros((n, 3)),
            "world.person_capacity": np.full((n, 1), 0.4),
            "world.person_activation": np.full((n, 4), 0.5),
        }

    def value(self, name: str) -> Any:
        return self.truth[name]


def test_a_hole_counts_after_five_seconds_without_a_touch():
    found = drilling_trial.read(Faked((5.1, 4.9, 4.99, 7.0), 0, None), "H", A, 4)  # type: ignore[arg-type]
    assert found["N_Hl"] == 3.0
    assert found["T"] == pytest.approx(39.8 / 3, abs=0.01)
    assert found["off_mm"] == pytest.approx(5.0)
    assert (found["finished"], found["gave_up"]) == (1.0, 0.0)


def test_who_gives_up_keeps_the_holes_done():
    found = drilling_trial.read(Faked((5.1, 5.2, 0.0, 0.0), 2, 2), "H", A, 4)  # type: ignore[arg-type]
    assert (found["N_Hl"], found["gave_up"], found["finished"]) == (2.0, 1.0, 0.0)
    assert found["T"] == pytest.approx(19.8 / 2, abs=0.1)
    none = drilling_trial.read(Faked((0.0,) * 4, 2, 1), "H", A, 4)  # type: ignore[arg-type]
    assert none["N_Hl"] == 0
    assert none["T"] is None


def trial(subject: str, condition: str, holes: float, time: float, errors: float) -> Trial:
    metrics = {
        "tried": 20,
        "N_Hl": holes,
        "T": time,
        "N_err": errors,
        "off_mm": 1.0,
        "missed": 0.0,
        "gave_up": 0.0,
        "finished": 1.0,
    }
    return Trial(subject, condition, metrics | {"AD": 1.0, "PD": 2.0, "BC": 3.0, "TR": 4.0}, f"{subject}-{condition}")


@pytest.mark.slow
def test_who_completed_no_hole_is_named_and_isnt_in_the_times(tmp_path):
    found = [
        *(trial(f"P{k:02}", "HR", 20, 9 + 0.1 * k, 0) for k in range(1, 5)),
        *(trial(f"P{k:02}", "H", 10 + k, 8, 1) for k in range(1, 4)),
        trial("P04", "H", 0, math.nan, 5),
    ]
    result = overhead_drilling.result(found, tmp_path)
    claims = {claim.id: claim for claim in result.claims}
    assert claims["robot-more-holes"].measured == pytest.approx(20 - (11 + 12 + 13 + 0) / 4)
    assert claims["robot-fewer-errors"].measured == pytest.approx(-2.0)
    assert claims["robot-slower"].measured == pytest.approx(1.2)
    assert claims["robot-slower"].holds
    assert not claims["robot-fewer-errors"].holds, "the interval of -1, -1, -1, -5 crosses 0"
    assert "without P04" in claims["robot-slower"].text
    assert [row["subject"] for row in result.table][:5] == ["P01", "P02", "P03", "P04", "mean (sd)"]
    assert result.table[3]["T H"] is None
    assert result.table[2]["T H"] == 8.0
    assert result.table[4]["T H"] == "8.00 (0.00)"


@pytest.mark.slow
def test_a_trial_of_fewer_holes_counts_by_its_share(tmp_path):
    found = [trial(f"P{k:02}", c, 20, 9.0 + k, k) for k in range(1, 4) for c in ("HR", "H")]
    found = [
        Trial(t.subject, "HR", {**t.values, "tried": 5, "N_Hl": 5.0, "N_err": 1.0}) if t.condition == "HR" else t
        for t in found
    ]
    claims = {claim.id: claim for claim in overhead_drilling.result(found, tmp_path).claims}
    assert claims["robot-more-holes"].measured == 0.0
    assert claims["robot-fewer-errors"].measured == pytest.approx(4.0 - 2.0)
    assert "drilled: H 20, HR 5" in claims["robot-more-holes"].text


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("condition", ["H", "HR"])
def test_a_person_drills_a_hole(condition):
    given = {"person": asdict(persons()[2]), "condition": condition, "holes": {condition: 1}, "changed": {}}
    found: Any = drilling_trial.trial(text(condition), given, 3)
    assert (found["N_Hl"], found["finished"], found["missed"], found["stop"]) == (1.0, 1.0, 0.0, "")
    assert 5.0 < found["T"] < 30.0


@pytest.mark.slow
@pytest.mark.exhaustive  # each kind of trial has a test of its own
def test_a_short_study_runs(tmp_path: Path) -> None:
    result = overhead_drilling.run(tmp_path, quick=True, runner=Runner(LocalEngine(1)))
    assert [claim.id for claim in result.claims] == ["robot-more-holes", "robot-fewer-errors", "robot-slower"]
    assert (tmp_path / "trials" / "rows.parquet").is_file()
