"""The study of load carrying: its plan and world, what its claims say, and a short run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.study import cell
from pydantic import TypeAdapter
from ruamel.yaml import YAML

import studies.runs
from runtime.contracts.errors import RequestError
from sim.parts.person.plans import Plan
from sim.parts.things.load import LoadConfig
from studies.runs import Task, run_all
from studies.superman import load_carrying as study
from studies.superman.assumptions import assumed

GOOD = study.Outcome(
    taken=10.0, lifted=14.0, lowered=40.0, placed=45.0, force=np.array([0.0, 0.0, -98.0]), net=-98.1, spread=1.0,
    off=0.01, tilt=0.0, stands=True, touches=0, least=0.3, way=4.0, manipulation=20.0, locomotion=30.0, missed=0,
    strongest=150.0, stopped=False,
)  # fmt: skip


def holding(outcome: study.Outcome) -> set[str]:
    return {claim.id for claim in study.claims(outcome, assumed(study.NAME)) if claim.holds}


def test_the_hand_is_led_by_the_middle_of_its_hollow() -> None:
    setup = assumed(study.NAME)
    world = cell(study.task("any", setup))
    palm = world.data.xmat[world.model.body("hand/palm").id].reshape(3, 3)
    hollow = LoadConfig.model_fields["hollow"].default
    np.testing.assert_allclose(palm @ hollow, setup["hollow"], atol=1e-6)
    # The bar is where the plan says that the hollow of the hand is going to be.
    low = setup["table"][2] + setup["size"][2] + setup["grip"]
    grasp = world.data.site_xpos[world.model.site("load/grasp").id]
    np.testing.assert_allclose(grasp, [*setup["pick"], low], atol=2e-3)


@pytest.mark.parametrize("short", [False, True])
def test_the_plan_is_one_of_the_person_and_ends_with_the_admittance_off(short: bool) -> None:
    setup = study.shortened(assumed(study.NAME)) if short else assumed(study.NAME)
    plan = TypeAdapter(Plan).validate_python(study.plan(setup))
    presses = [step.button for step in plan if step.do == "press"]
    assert presses == ["A", "P", "P", "G", "P", "P", "G", "A"]


def test_all_claims_hold_of_a_good_run() -> None:
    assert holding(GOOD) == {"load-carried", "load-force", "obstacles-clear", "both-modes"}


@pytest.mark.parametrize(
    ("claim", "change"),
    [
        ("load-carried", {"off": 0.06}),
        ("load-carried", {"stands": False}),
        ("load-carried", {"tilt": 0.5}),
        ("load-carried", {"placed": None}),
        ("load-carried", {"stopped": True}),
        ("load-force", {"force": np.array([0.0, 0.0, -90.0])}),
        ("load-force", {"force": None}),
        ("obstacles-clear", {"touches": 1}),
        ("obstacles-clear", {"least": -0.01}),
        ("both-modes", {"locomotion": 0.0}),
        ("both-modes", {"lifted": None, "lowered": None}),
    ],
)
def test_a_claim_fails_of_a_run_that_did_otherwise(claim: str, change: dict[str, object]) -> None:
    assert claim not in holding(replace(GOOD, **change))


def test_a_study_keeps_the_order_of_a_profiles_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[str]] = []

    class Done:
        returncode, stdout, stderr = 2, "", "no"

    def pretend(command: list[str], **_: object) -> Done:
        profile = YAML(typ="safe", pure=True).load(Path(command[4]))
        seen.append(list(profile["devices"]["panel"]["buttons"]))
        return Done()

    monkeypatch.setattr(studies.runs.subprocess, "run", pretend)
    with pytest.raises(RequestError):
        run_all([Task("any", "kairos-man", {}, 1.0, 1)], tmp_path)
    assert seen == [["A", "M", "G", "P"]]  # guide-buttons knows them by their places
