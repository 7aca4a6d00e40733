"""The overhead-drilling study: its set-up, how its figures are read, and short trials through the runtime."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.study import cell

from studies.runs import run_all
from studies.superman import overhead_drilling
from studies.superman.assumptions import assumed
from studies.superman.persons import persons
from studies.superman.user_study import Planned, trials
from studies.toolkit.trials import Trial

A = assumed("overhead-drilling")


def test_the_drill_starts_upright_under_the_first_hole_in_both_conditions():
    tips = []
    for condition in ("HR", "H"):
        world = cell(overhead_drilling.task(persons()[0], condition, A))
        tip, hole = world.data.site("drill/tip").xpos, world.data.site("plate/hole_0").xpos
        assert world.data.body("drill/drill").xmat.reshape(3, 3)[2, 2] > 0.999
        assert hole[2] == pytest.approx(1.9)
        np.testing.assert_allclose(tip[:2], hole[:2], atol=2e-3)
        assert 0.03 < hole[2] - tip[2] < 0.12
        tips.append(tip.copy())
        assert world.model.body("drill/drill").mass[0] == pytest.approx(5.0)
    np.testing.assert_allclose(tips[0], tips[1], atol=2e-3)


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
    found = overhead_drilling.read(Faked((5.1, 4.9, 4.99, 7.0), 0, None), "H", A, 4)  # type: ignore[arg-type]
    assert found["N_Hl"] == 3.0
    assert found["T"] == pytest.approx(39.8 / 3, abs=0.01)
    assert found["off_mm"] == pytest.approx(5.0)
    assert (found["finished"], found["gave_up"]) == (1.0, 0.0)


def test_who_gives_up_keeps_the_holes_done():
    found = overhead_drilling.read(Faked((5.1, 5.2, 0.0, 0.0), 2, 2), "H", A, 4)  # type: ignore[arg-type]
    assert (found["N_Hl"], found["gave_up"], found["finished"]) == (2.0, 1.0, 0.0)
    assert found["T"] == pytest.approx(19.8 / 2, abs=0.1)
    none = overhead_drilling.read(Faked((0.0,) * 4, 2, 1), "H", A, 4)  # type: ignore[arg-type]
    assert none["N_Hl"] == 0
    assert math.isnan(none["T"])


def trial(subject: str, condition: str, holes: float, time: float, errors: float) -> Trial:
    figures = {"N_Hl": holes, "T": time, "N_err": errors, "off_mm": 1.0, "missed": 0.0, "gave_up": 0.0}
    return Trial(subject, condition, figures | {"AD": 1.0, "PD": 2.0, "BC": 3.0, "TR": 4.0}, f"{subject}-{condition}")


def test_who_completed_no_hole_is_named_and_isnt_in_the_times(tmp_path):
    found = [
        *(trial(f"S{k}", "HR", 20, 9 + 0.1 * k, 0) for k in range(1, 5)),
        *(trial(f"S{k}", "H", 10 + k, 8, 1) for k in range(1, 4)),
        trial("S4", "H", 0, math.nan, 5),
    ]
    result = overhead_drilling.result(found, tmp_path)
    claims = {claim.id: claim for claim in result.claims}
    assert claims["robot-more-holes"].measured == pytest.approx(20 - (11 + 12 + 13 + 0) / 4)
    assert claims["robot-fewer-errors"].measured == pytest.approx(-2.0)
    assert claims["robot-slower"].measured == pytest.approx(1.2)
    assert all(claim.holds for claim in result.claims)
    assert "without S4" in claims["robot-slower"].text
    assert [row["subject"] for row in result.table][:5] == ["S1", "S2", "S3", "S4", "mean (sd)"]
    assert result.table[3]["T H"] is None
    assert result.table[2]["T H"] == 8.0
    assert result.table[4]["T H"] == "8.00 (0.00)"


def test_trials_that_are_there_arent_run_again(tmp_path, monkeypatch):
    task = overhead_drilling.task(persons()[0], "H", A)
    ran = []

    def run_all(tasks, folder, workers):
        ran.append(tasks[0].name)
        file = folder / f"{tasks[0].name}.rrd"
        file.touch()
        return [SimpleNamespace(file=file)]

    monkeypatch.setattr("studies.superman.user_study.run_all", run_all)
    planned = [Planned(persons()[0], "H", task, lambda run: {"T": 1.0})]
    for _ in range(2):
        assert trials(planned, tmp_path)[0].values == {"T": 1.0}
    assert ran == ["s1-h"]
    changed = overhead_drilling.task(persons()[0], "H", A | {"depth": 0.05})
    trials([Planned(persons()[0], "H", changed, lambda run: {"T": 2.0})], tmp_path)
    assert len(ran) == 2


@pytest.mark.slow
@pytest.mark.parametrize("condition", ["H", "HR"])
def test_a_person_drills_a_hole_through_the_runtime(condition, tmp_path):
    done = run_all([overhead_drilling.task(persons()[2], condition, A, holes=1)], tmp_path)[0]
    found = overhead_drilling.read(done, condition, A, 1)
    assert done.summary["cause"] == "end"
    assert (found["N_Hl"], found["finished"], found["missed"]) == (1.0, 1.0, 0.0)
    assert 5.0 < found["T"] < 30.0
