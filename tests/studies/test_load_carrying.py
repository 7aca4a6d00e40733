"""The study of load carrying: its plan and world, what its claims say, and a short run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.study import cell
from pydantic import TypeAdapter

from srl.runtime.contracts.rotation import exp, product
from srl.sim.parts.person.plans import Plan
from srl.sim.parts.things.load import LoadConfig
from srl.studies.simulated import Run
from srl.studies.superman import load_carrying as study
from srl.studies.superman import load_figure, load_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import persons
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.runner import Runner

A = assumed(load_trial.STUDY)
WHO = persons()[0]
STRAIGHT = replace(WHO, tilt_x=0.0, tilt_y=0.0)
GOOD: dict[str, Any] = {
    "taken": 10.0, "lifted": 14.0, "lowered": 40.0, "placed": 45.0, "force_z": -98.0, "net": -98.1, "spread": 1.0,
    "off": 0.01, "tilt": 0.0, "stands": True, "touches": 0, "least": 0.3, "way": 4.0, "manipulation": 20.0,
    "locomotion": 30.0, "missed": 0, "strongest": 150.0, "stop": "",
}  # fmt: skip


def holding(rows: list[dict[str, Any]]) -> set[str]:
    return {claim.id for claim in study.claims(rows, A) if claim.holds}


def test_the_hand_is_led_by_the_middle_of_its_hollow() -> None:
    world = cell(load_trial.setup(STRAIGHT, A))
    palm = world.data.xmat[world.model.body("hand/palm").id].reshape(3, 3)
    hollow = LoadConfig.model_fields["hollow"].default
    np.testing.assert_allclose(palm @ hollow, A["hollow"], atol=1e-6)
    # The bar is where the plan says that the hollow of the hand is going to be.
    low = A["table"][2] + A["size"][2] + A["grip"]
    grasp = world.data.site_xpos[world.model.site("load/grasp").id]
    np.testing.assert_allclose(grasp, [*A["pick"], low], atol=2e-3)


def test_the_hand_is_as_tilted_as_its_person() -> None:
    turns = [cell(load_trial.setup(who, A)).data.body("hand/palm").xmat.reshape(3, 3).copy() for who in (STRAIGHT, WHO)]
    angle = np.arccos((np.trace(turns[1] @ turns[0].T) - 1.0) / 2.0)
    assert angle == pytest.approx(np.hypot(WHO.tilt_x, WHO.tilt_y), rel=1e-3)


@pytest.mark.parametrize("short", [False, True])
def test_the_plan_is_one_of_the_person_and_ends_with_the_admittance_off(short: bool) -> None:
    setup = load_trial.shortened(A) if short else A
    plan = TypeAdapter(Plan).validate_python(load_trial.plan(setup))
    presses = [step.button for step in plan if step.do == "press"]
    assert presses == ["A", "P", "P", "G", "P", "P", "G", "A"]


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_row_says_how_the_load_went_and_stands(tilt: float) -> None:
    n, across = 1000, exp(0.0, 0.0, np.pi / 2)
    held, far = (np.arange(n) > 100) & (np.arange(n) < 900), (np.arange(n) > 200) & (np.arange(n) < 800)
    pose = np.tile([*A["place"], 0.6, *product(exp(tilt, 0.0, 0.0), across)], (n, 1))
    pose[:500, 0] -= 1.0
    modes = np.zeros((n, load_trial._LOCOMOTION + 1))
    modes[:, load_trial._LOCOMOTION] = far
    felt = np.tile([0.0, 0.0, -98.0, 0.0, 0.0, 0.0], (n, 1))
    values = {
        "world.load_held": held[:, None].astype(float), "world.load_pose": pose, "keys.modes": modes,
        "world.to_contact_force": np.tile([0.0, 0.0, -98.07], (n, 1)), "world.boxes_touches": np.zeros((n, 3)),
        "world.boxes_distance": np.full((n, 1), 0.2), "world.person_progress": np.zeros((n, 3)),
        "world.person_wrench": np.full((n, 6), 1.0), "world.arm_flange": np.zeros((n, 3)), "arm.wrench": felt,
    }  # fmt: skip
    run = Run(0.01 * np.arange(n), values, np.zeros(n), True)
    row = load_trial.read(run, A)
    assert row["tilt"] == pytest.approx(tilt, abs=1e-9)
    assert study.carried(row, A) == (tilt == 0.0)
    assert [row[name] for name in ("taken", "lifted", "lowered", "placed")] == pytest.approx([1.01, 2.01, 7.99, 8.99])
    assert (row["off"], row["way"], row["force_z"], row["net"]) == pytest.approx((0.0, 1.0, -98.0, -99.0))
    assert len(json.loads(load_trial.series(run))["t"]) == n


def test_all_claims_hold_of_good_runs_of_which_one_may_fail() -> None:
    every = {"load-carried", "load-force", "obstacles-clear", "both-modes"}
    assert holding([GOOD] * 10) == every
    assert holding([GOOD] * 9 + [GOOD | {"touches": 1, "stop": "device fault"}]) == every


@pytest.mark.parametrize(
    ("claim", "change"),
    [
        ("load-carried", {"off": 0.06}),
        ("load-carried", {"stands": False}),
        ("load-carried", {"tilt": 0.5}),
        ("load-carried", {"placed": None}),
        ("load-carried", {"stop": "device fault"}),
        ("load-force", {"force_z": -90.0}),
        ("load-force", {"force_z": None}),
        ("obstacles-clear", {"touches": 1}),
        ("obstacles-clear", {"least": -0.01}),
        ("both-modes", {"locomotion": 0.0}),
        ("both-modes", {"lifted": None, "lowered": None}),
    ],
)
def test_a_claim_fails_of_runs_that_did_otherwise(claim: str, change: dict[str, object]) -> None:
    assert claim not in holding([GOOD | change] * 10)


LOST = GOOD | dict.fromkeys(("taken", "lifted", "lowered", "placed", "force_z", "net", "spread"))


def test_the_table_stands_without_anybody_who_got_that_far() -> None:
    assert {row[""] for row in study.table([LOST], A)} == {row[""] for row in study.table([GOOD] * 3, A)}


@pytest.mark.slow
def test_the_figure_stands_too(tmp_path: Path) -> None:
    t = np.linspace(0.0, 50.0, 100)
    shown = {
        "t": t.tolist(), "at": np.column_stack([t, t, t]).tolist(), "force": np.zeros((100, 3)).tolist(),
        "locomotion": (t > 25.0).tolist(),
    }  # fmt: skip
    for row in (LOST, GOOD):
        load_figure.draw(row, json.loads(json.dumps(shown)), A, tmp_path / "load.png")
        assert (tmp_path / "load.png").stat().st_size > 5000


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_short_study_runs(tmp_path: Path) -> None:
    result = study.run(tmp_path, quick=True, runner=Runner(LocalEngine(1)))
    assert {claim.id for claim in result.claims} == {"load-carried", "load-force", "obstacles-clear", "both-modes"}
    assert (tmp_path / "load-carrying.png").stat().st_size > 5000
