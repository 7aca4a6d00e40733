"""The peg-in-hole study: its set-up, its measures, its claims, a short run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.study import cell, profile
from ruamel.yaml import YAML

from studies.superman.assumptions import FILE, assumed
from studies.superman.peg_in_hole import (
    COMPLIANT,
    CONDITIONS,
    KAIROS_BARE,
    MOCA,
    STUDY,
    Condition,
    Outcome,
    claims,
    run,
    smoothed,
    task,
)


def test_every_assumption_has_a_source() -> None:
    sections = YAML(typ="safe", pure=True).load(FILE)
    for name in (STUDY, "passivity"):
        for key, entry in sections[name].items():
            assert set(entry) == {"value", "source"}, f"{name}: {key}"
            assert entry["source"]


@pytest.mark.parametrize("condition", [MOCA, COMPLIANT], ids=lambda c: c.robot)
def test_the_peg_begins_above_the_hole_and_its_mass_is_what_the_robot_is_told(condition: Condition) -> None:
    a = assumed(STUDY)
    done = task(condition, 1, a)
    world = cell(done)
    tip, mouth = world.data.site("peg/tip").xpos, world.data.site("hole/mouth").xpos
    assert tip[2] - mouth[2] > a["above"]
    assert np.linalg.norm(tip[:2] - mouth[:2]) < 0.1
    flange = world.model.body("arm/flange").id
    turn, at = world.data.xmat[flange].reshape(3, 3), world.data.xpos[flange]
    arm = profile(done)["devices"]["arm"]
    mass, centre = (
        (arm["load"]["mass"], arm["load"]["centre"]) if "load" in arm else (arm["payload"], arm["payload_cog"])
    )
    assert mass == pytest.approx(world.model.body_subtreemass[flange], abs=1e-3)
    np.testing.assert_allclose(centre, turn.T @ (world.data.subtree_com[flange] - at), atol=1e-3)


def test_as_published_means_without_what_the_runtime_adds() -> None:
    entries = {e.get("name"): e for e in task(KAIROS_BARE, 1, assumed(STUDY)).changes["controllers"]}
    assert entries["guide"]["leash"] is None
    assert entries["guide"]["tank"] is None
    assert entries["body"]["speed"] is None
    assert "force_feedback" not in entries["body"]


def test_running_means() -> None:
    values = np.zeros((10, 3))
    values[4] = [4.0, 0.0, 0.0]
    means = smoothed(values, np.arange(10) * 0.001, 0.002)
    np.testing.assert_allclose(means[:, 0], [0, 0, 0, 0, 2, 2, 0, 0, 0, 0])


def outcomes() -> list[Outcome]:
    """As in the paper."""
    found = []
    for condition in CONDITIONS:
        fails = condition is KAIROS_BARE
        for seed in (1, 2):
            found.append(
                Outcome(
                    condition, seed, 200.0 if fails else 20.0, 15.0, 0.0 if fails else 0.03, not fails, not fails, 0,
                    "device fault" if fails else "", 5.0 if fails else None,
                )
            )  # fmt: skip
    return found


def test_claims_need_every_seed() -> None:
    a, paper = assumed(STUDY), outcomes()
    assert all(claim.holds for claim in claims(paper, a))
    for condition, change, fallen in (
        (MOCA, {"force": 30.0}, {"moca-force-below-payload"}),
        (MOCA, {"withdrew": False}, {"moca-inserts"}),
        (KAIROS_BARE, {"force": 102.0}, {"kairos-exceeds-payload"}),
        (KAIROS_BARE, {"cause": ""}, {"kairos-exceeds-payload"}),
        (COMPLIANT, {"force": 160.0}, {"kairos-compliant-inserts"}),
    ):
        changed = [replace(o, **change) if o.condition is condition and o.seed == 2 else o for o in paper]
        assert {claim.id for claim in claims(changed, a) if not claim.holds} == fallen


@pytest.mark.slow
def test_a_short_study_runs(tmp_path: Path) -> None:
    result = run(tmp_path, quick=True)
    assert {row["robot"] for row in result.table} == {KAIROS_BARE.label, COMPLIANT.label}
    assert all(Path(file).stat().st_size > 0 for file in result.files)
    assert all(row["largest force N"] > 0 for row in result.table)
