"""A task that the arm does by itself beside a wearer who doesn't look, and what the analysis makes of many."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.trial_rows import Here, row
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.profile import profile
from srl.studies.human_srl import operation_claims
from srl.studies.human_srl.operation_claims import CONDITIONS, MOVING, STILL
from srl.studies.human_srl.operation_trial import PROFILE, Case, Trial, run, trial
from srl.studies.human_srl.reaching import AVERAGE
from srl.studies.human_srl.wearers import wearers
from srl.studies.tasks.task import Row

TEXT = profile.find(PROFILE)[1]
WHO = wearers(20)
TASKS = [operation_claims.task(one, name) for one in WHO for name in CONDITIONS]
POSITIVE = st.lists(st.floats(0.0, 0.1), min_size=1, max_size=60)


@given(POSITIVE)
def test_on_a_path_that_never_waits_the_errors_figures_are_the_plain_ones(errors: list[float]) -> None:
    mean, p95, most = Trial(errors=errors, progress=[0.01] * len(errors)).metrics()
    assert mean == pytest.approx(1e3 * np.mean(errors), abs=1e-9)
    assert most == 1e3 * max(errors)
    assert p95 == pytest.approx(1e3 * np.quantile(errors, 0.95, method="inverted_cdf"))


def test_waiting_does_not_count_but_in_the_greatest() -> None:
    going = Trial(errors=[0.002, 0.004] * 50, progress=[0.01] * 100)
    waits = Trial(errors=[0.002, 0.004] * 50 + [0.03] * 900, progress=[0.01] * 100 + [0.0] * 900)
    assert waits.metrics()[:2] == pytest.approx(going.metrics()[:2])
    assert waits.metrics()[2] == 30.0
    assert all(math.isnan(v) for v in Trial(errors=[0.1], progress=[0.0]).metrics())


def rows(change: Callable[[str, int], dict[str, object]] = lambda *_: {}) -> list[Row]:
    """Rows in which nothing goes wrong but what `change` says of a condition and a wearer."""
    made = []
    for task in TASKS:
        name, n = task.parameters["condition"], task.seed
        values = {
            "mean": 3.0 + 0.01 * n + (0.1 if name == MOVING else 0.0) * (n % 3), "p95": 6.0, "most": 10.0, "taken": 5.0,
            "done": True, "contacts": 3, "blamed": 0, "blocked": 0.1, "fastest": 0.01,
        }  # fmt: skip
        made.append(row(task, values | change(name, n)))
    return made


def judged(change: Callable[[str, int], dict[str, object]]) -> dict[str, bool]:
    return {claim.id: claim.holds for claim in operation_claims.analysed(rows(change)).claims}


def test_each_claim_fails_by_what_it_is_about_alone() -> None:
    every = {"independent-tip-error": True, "independent-done": False, "independent-no-blame": True}
    assert judged(lambda *_: {}) == every, "20 of 20 done bound it by 83 % only"
    assert not judged(lambda name, n: {"mean": 3.0 + (3.0 + 0.02 * n) * (name == MOVING)})["independent-tip-error"]
    assert not judged(lambda name, n: {"blamed": int(name == STILL and n == 7)})["independent-no-blame"]
    assert judged(lambda name, n: {"blamed": int("no stop" in name)})["independent-no-blame"]


def test_table_counts_contacts_and_takes_the_time_of_what_was_done() -> None:
    def change(name: str, n: int) -> dict[str, object]:
        return (
            {"done": n % 2 == 0, "taken": 60.0 if n % 2 else 20.0, "blamed": 2, "fastest": 0.1}
            if name == MOVING
            else {}
        )

    part = operation_claims.analysed(rows(change))
    lines = {line["condition"]: line for line in part.table}
    assert lines[MOVING]["time_s"] == 20.0
    assert (lines[MOVING]["done"], lines[MOVING]["contacts"], lines[MOVING]["blamed"]) == (10, 60, 40)
    assert lines[MOVING]["fastest_blamed"] == 0.1
    assert math.isnan(lines[STILL]["fastest_blamed"])
    assert lines[STILL]["error_mm_low"] < lines[STILL]["error_mm"] < lines[STILL]["error_mm_high"]
    assert not {claim.id: claim for claim in part.claims}["independent-done"].holds


def test_without_rows_nothing_is_measured_and_nothing_holds() -> None:
    assert all(c.measured is None and not c.holds for c in operation_claims.analysed([]).claims)


@pytest.mark.slow
def test_path_is_repeated_by_a_late_servo_within_some_millimetres_beside_a_wearer_who_stands_still() -> None:
    found = run(TEXT, AVERAGE, Case(still=True), 1)
    mean, p95, most = found.metrics()
    assert found.done
    assert not found.contacts
    assert found.seconds < 8.0
    # Mostly the servo's delay of 30 ms at up to 0.25 m/s.
    assert mean < 5.0
    assert p95 < 10.0
    assert most < 15.0


@pytest.mark.exhaustive
@pytest.mark.slow
def test_task_is_done_beside_a_moving_wearer_who_makes_it_wait() -> None:
    found = run(TEXT, AVERAGE, Case(), 1)
    assert found.done
    assert found.seconds > 7.0
    assert not found.blamed
    assert found.metrics()[2] < 20.0


@pytest.mark.exhaustive
@pytest.mark.slow
def test_without_the_distances_and_the_verified_stop_the_arm_runs_into_the_wearer() -> None:
    bare = Case(guarded=False, replay={"around": "ignore"})
    assert sum(run(TEXT, AVERAGE, bare, seed).blamed for seed in range(8)) > 0


@pytest.mark.exhaustive
@pytest.mark.slow
def test_quick_set_is_whole_and_repeats_itself(tmp_path: Path) -> None:
    here = Here({"human-srl-operation": trial})
    part = operation_claims.claims(here, tmp_path, True)  # type: ignore[arg-type]
    assert [line["condition"] for line in part.table] == list(CONDITIONS)
    assert {claim.id: claim.holds for claim in part.claims}["independent-no-blame"]
    task = operation_claims.task(WHO[0], "still, no stop")
    assert trial(task.text, task.parameters, task.seed) == trial(task.text, task.parameters, task.seed)
