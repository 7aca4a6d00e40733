"""The passivity study: its margin against a simulated delay, its measured lag, its claims, a short run."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from studies.superman.assumptions import assumed
from studies.superman.passivity import STUDY, Case, Outcome, cases, claims, lag, margin, run

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
    assert lag(t, force, moved, a) == pytest.approx(delay, abs=3e-4)


def outcomes() -> list[Outcome]:
    """What all claims ask for: the bare law rings beyond its margin, the tank doesn't."""
    found = []
    for case in cases(assumed(STUDY), quick=False):
        rings = case.late > 0 and not case.tank  # at 2000 N/m
        verdict = "grows" if rings else "dies"
        found.append(
            Outcome(case, 0.1, 0.2 if rings else 0.01, 2.0 if rings else 0.1, verdict, 0.1, 0.2, 0.008, 0.0, "")
        )
    return found


def test_claims_follow_the_runs() -> None:
    a = assumed(STUDY)
    good = outcomes()
    assert all(claim.holds for claim in claims(good, a))
    worse = [replace(o, verdict="grows", growth=3.0, given=2.0) if o.case.tank and o.case.told else o for o in good]
    fallen = {claim.id for claim in claims(worse, a) if not claim.holds}
    assert fallen == {"tank-no-growth", "tank-dies-out", "tank-energy"}


def test_the_stiffness_range_is_covered_for_both_robots() -> None:
    chosen = cases(assumed(STUDY), quick=False)
    for robot in ("moca", "kairos"):
        stiffness = [case.stiffness for case in chosen if case.robot == robot]
        assert (min(stiffness), max(stiffness)) == (200.0, 2000.0)
    assert all(Case(c.robot, c.stiffness, c.late, not c.tank) in chosen for c in chosen if not c.told)


@pytest.mark.slow
def test_a_short_study_runs_and_a_relaxed_hand_is_still_with_the_bare_law(tmp_path: Path) -> None:
    result = run(tmp_path, quick=True)
    assert [row["stop"] for row in result.table] == ["none", "none"]
    assert all(Path(file).stat().st_size > 0 for file in result.files)
    assert 0.0 < result.table[0]["delay ms"] < 100.0
    assert result.table[0]["verdict"] in ("dies", "still")
