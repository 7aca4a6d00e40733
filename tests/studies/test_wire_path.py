"""The wire-path study: its persons, its set-up, and how its figures are read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.study import cell

from studies.runs import run_all
from studies.superman import wire_path
from studies.superman.assumptions import assumed
from studies.superman.persons import drawn, persons
from studies.toolkit.trials import Trial

A = assumed("wire-path")
PATH = wire_path._path(A)


def test_the_persons_are_those_drawn_from_the_stated_distributions():
    assert assumed("persons")["list"] == drawn()
    everyone = persons()
    assert [p.name for p in everyone] == [f"S{i}" for i in range(1, 13)]
    assert len({p.seed for p in everyone}) == 12
    assert 1.66 < np.mean([p.height for p in everyone]) < 1.78  # 172.0 (10.1) cm in the paper
    assert everyone[0].options(overhead=True)["strength"] < everyone[0].options(overhead=False)["strength"]


def test_the_ring_starts_before_the_wire_alike_in_both_conditions():
    places = []
    for condition in ("HR", "H"):
        world = cell(wire_path.task(persons()[0], condition, A))
        ring, site = world.data.body("ring/ring"), world.data.site
        start, then = site("wire/path_0").xpos, site("wire/path_1").xpos
        along = ring.xmat.reshape(3, 3)[:, 0]
        assert along @ (then - start) / np.linalg.norm(then - start) == pytest.approx(1.0, abs=0.02)
        assert np.linalg.norm(ring.xpos - start) == pytest.approx(0.07, abs=0.002)
        assert not world.truth_arrays["wire_touches"].any()
        places.append(ring.xpos.copy())
    np.testing.assert_allclose(places[0], places[1], atol=1e-3)


class Faked:
    """A run's truth by hand: 0.1 s a row; 20 s on the way, 10 s at each of two marks, then the rest."""

    def __init__(self, first: int, touched: tuple[float, ...], marks: tuple[float, ...]) -> None:
        turn = wire_path.normalised(A["wire_quaternion"])
        at = [np.array(wire_path.turned(turn, PATH.at(m * PATH.length)[:3])) + A["wire"] for m in marks]
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
    found = wire_path.read(run, "H")  # type: ignore[arg-type]
    assert found["N_err"] == 2.0
    assert found["T"] == pytest.approx(49.9)
    assert found["off_mm"] == pytest.approx(5.0)
    assert found["AD"] == 25.0


def trials(errors: dict[str, tuple[float, ...]]) -> list[Trial]:
    figures = {"off_mm": 1.0, "missed": 0.0, "AD": 1.0, "PD": 2.0, "BC": 3.0, "TR": 4.0}
    return [
        Trial(f"S{k + 1}", condition, figures | {"N_err": e, "T": 130.0 + k + (30 if condition == "HR" else 0)}, f"{k}")
        for condition, all_of in errors.items()
        for k, e in enumerate(all_of)
    ]


def test_a_claim_that_doesnt_hold_is_reported_so(tmp_path):
    result = wire_path.result(trials({"HR": (2, 1, 3), "H": (0, 1, 1)}), tmp_path)
    held = {claim.id: (claim.holds, claim.measured) for claim in result.claims}
    assert held["robot-fewer-errors"] == (False, pytest.approx(4 / 3))
    assert held["robot-slower"] == (True, pytest.approx(30.0))
    assert [row["subject"] for row in result.table][:4] == ["S1", "S2", "S3", "mean (sd)"]
    assert len({tuple(row) for row in result.table}) == 1
    for file in result.files:
        if file.endswith(".png"):
            assert (tmp_path / file).stat().st_size > 5000


@pytest.mark.slow
def test_a_person_leads_the_ring_along_the_wire_alone(tmp_path):
    a = A | {"marks": []}
    done = run_all([wire_path.task(persons()[0], "H", a)], tmp_path)[0]
    found = wire_path.read(done, "H")
    assert done.summary["cause"] == "end"
    assert found["finished"] == 1.0
    assert found["missed"] == 0.0
    assert 2 * PATH.length / persons()[0].follow < found["T"] < 150
    assert math.isfinite(found["off_mm"])


def test_no_step_presses_a_button_without_a_robot():
    for condition, first in (("H", "go_to"), ("HR", "press")):
        plan = wire_path.task(persons()[0], condition, A).changes["sim"]["parts"]["person"]["plan"]
        assert plan[0]["do"] == first
        assert [s["button"] for s in plan if s["do"] == "press"] == (["A", "M", "M", "A"] if first == "press" else [])
