"""The passivity study: its margin against a simulated delay, its measured lag, its claims, a short run."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.trial_rows import Here, row

from srl.studies.superman.assumptions import assumed
from srl.studies.superman.lag import lag
from srl.studies.superman.passivity import STUDY, TRIAL, claims, line, margin, run, tasks
from srl.studies.superman.passivity_trial import scene, trial
from srl.studies.tasks.task import Row

DT = 1e-4


def growth(stiffness: float, delay: float, hand: float = 0.0) -> float:
    """Last to first third's RMS speed of the bare law after a knock, by numbers."""
    late = deque([(0.0, 0.0)] * max(1, round(delay / DT)))
    x, v, speeds = 0.0, 0.3, []
    for _ in range(40_000):
        late.append((x, v))
        seen, pace = late.popleft()
        v += DT * (-stiffness * seen - hand * pace - 20.0 * v) / 3.0
        x += DT * v
        speeds.append(v)
    third = len(speeds) // 3
    return float(np.linalg.norm(speeds[-third:]) / np.linalg.norm(speeds[:third]))


@pytest.mark.parametrize(("stiffness", "hand"), [(500.0, 0.0), (2000.0, 0.0), (2000.0, 5.0)])
def test_the_margin_is_where_a_delayed_spring_begins_to_ring(stiffness: float, hand: float) -> None:
    edge = margin(stiffness, 3.0, 20.0, hand)
    assert growth(stiffness, 0.9 * edge, hand) < 1 < growth(stiffness, 1.1 * edge, hand)


def test_the_margin_at_2000_newtons_a_metre_is_about_10_ms() -> None:
    assert margin(2000.0, 3.0, 20.0) == pytest.approx(0.0101, abs=1e-4)


@pytest.mark.parametrize("delay", [0.004, 0.011, 0.05])
def test_a_known_lag_is_found_between_samples(delay: float) -> None:
    a = assumed(STUDY)
    t = np.arange(0.0, 3.0, 0.002)
    force = np.zeros((len(t), 3))
    force[:, 0] = 20 * np.exp(-(((t - 1) / 0.1) ** 2))
    v = np.zeros_like(force)
    for k in range(1, len(t)):
        push = max(0.0, force[k, 0] - a["dead_band"])
        v[k, 0] = v[k - 1, 0] + 0.002 * (push - 20.0 * v[k - 1, 0]) / 3.0
    moved = np.zeros_like(v)
    moved[:, 0] = np.interp(t - delay, t, v[:, 0], left=0.0)
    found = lag(t, force, moved, a["mass"], a["damping"], a["dead_band"])
    assert found == pytest.approx(delay, abs=3e-4)


def rows(**changed: Any) -> list[Row]:
    """What all claims ask for: the bare law rings beyond its margin, the tank doesn't; `changed`: of the tank's."""
    found = []
    for one in tasks(assumed(STUDY), quick=False):
        p = one.parameters
        values: dict[str, Any] = {"cause": "intent loss" if p["scene"] == "lose" else "", "least": 0.1, "damped": 0.0}
        if p["scene"] in ("hold", "stiffen"):
            rings = p["law"] == "bare" and p["late"] > 0
            values |= {"first": 0.1, "last": 0.2 if rings else 0.01, "growth": 2.0 if rings else 0.1, "delay": 0.008}
            values |= {"verdict": "grows" if rings else "dies", "given": 0.1, "knocked": 0.2}
        elif p["scene"] in ("lean", "cart"):
            values |= {"wall": 30.0, "leaned": 20.0, "bounce": 0.001, "away": 0.95 * p["push"] / 40.0}
        elif p["scene"] == "leave":
            values |= {"leaned": 20.0, "left": 18.0 if p["law"] == "stays" else 5.0}
        else:
            values |= {"released": 0.5, "coasted": 0.03, "stopped": 0.2, "harsh": 9.0}
        if p["law"] in ("tank", "told"):
            values |= {name: value for name, value in changed.items() if name in values}
        found.append(row(one, values))
    return found


@pytest.mark.parametrize(
    ("changed", "fallen"),
    [
        ({}, set()),
        ({"verdict": "grows", "growth": 3.0}, {"tank-no-growth", "tank-dies-out"}),
        ({"given": 2.0}, {"tank-energy"}),
        ({"away": 0.1}, {"lean-free", "cart-free"}),
        ({"bounce": 0.02}, {"lean-rests"}),
        ({"left": 11.0}, {"let-go-yields"}),
        ({"coasted": 0.08}, {"let-go-stops", "loss-stops"}),
        ({"cause": "device fault"}, {"lean-rests", "loss-stops"}),
    ],
)
def test_claims_follow_the_rows(changed: dict[str, Any], fallen: set[str]) -> None:
    a = assumed(STUDY)
    found = rows(**changed)
    assert {claim.id for claim in claims(found, a) if not claim.holds} == fallen
    assert len({claim.id for claim in claims(found, a)}) == 12
    assert all(line(one, a)["robot"] in ("moca", "kairos") for one in found)


def test_without_rows_no_claim_but_the_analytic_one_holds() -> None:
    assert [claim.id for claim in claims([], assumed(STUDY)) if claim.holds] == ["analytic-margin"]


def test_both_robots_are_held_leaned_and_let_go_over_the_whole_range() -> None:
    chosen = [one.parameters for one in tasks(assumed(STUDY), quick=False)]
    for robot in ("moca", "kairos"):
        own = [p for p in chosen if p["robot"] == robot]
        stiffness = [p["stiffness"] for p in own if p["scene"] == "hold"]
        assert (min(stiffness), max(stiffness)) == (200.0, 2000.0)
        assert max(p["wall"] for p in own if p["scene"] == "lean") == 1e5
        assert {"hold", "stiffen", "lean", "leave", "cart", "let go", "lose"} == {p["scene"] for p in own}
    assert all(scene(p).seconds < 20.0 for p in chosen)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_short_study_runs_a_relaxed_hand_is_still_and_a_released_handle_stops(tmp_path: Path) -> None:
    result = run(tmp_path, True, Here({TRIAL: trial}))  # type: ignore[arg-type]
    assert [row["stop"] for row in result.table] == ["none"] * 3
    bare, _, released = result.table
    assert 0.0 < bare["delay ms"] < 100.0
    assert bare["verdict"] in ("dies", "still")
    assert released["released mm/s"] > 450.0
    assert released["coasted mm"] < 50.0
