"""Pieces of the studies of several DoFs and of robustness, and one short trial of each kind."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Hold
from srl.runtime.profile import profile
from srl.studies.ikns import dofs, dofs_trial, robustness, robustness_trial
from srl.studies.ikns.rig import FILE, Rig, angles_alone, instructed, sensing
from srl.studies.tasks.task import function

POINT = (0.26, -0.19, -0.10)  # m, in front of the chest


def finger_calibration() -> str:
    return (resources.files("srl.profiles") / FILE).read_text()


def two_calibration() -> str:
    return (resources.files("srl.profiles") / "ikns-two.calibration.json").read_text()


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_a_marker_is_gone_for_the_wanted_share_in_bursts(share: float) -> None:
    found = [robustness_trial.gaps(share, seed, marker) for seed in range(30) for marker in range(7)]
    lengths = np.array([b - a for windows in found for a, b in windows])
    assert lengths.min() >= 0.05 - 1e-3
    assert lengths.max() <= 0.7 + 1e-3
    whole = np.mean([sum(b - a for a, b in windows) / (windows[-1][1] - 3.0) for windows in found])
    assert whole == pytest.approx(share, rel=0.1)
    assert found[0] != found[1]


def test_every_trial_of_a_condition_is_a_task_of_its_own() -> None:
    made = robustness.tasks(robustness.conditions(), 2)
    assert len({task.identity for task in made}) == len(made)
    assert {task.trial for task in made} == {"ikns-robustness"}


@pytest.mark.slow
def test_labels_are_exchanged_while_it_is_due_and_not_before() -> None:
    rig = Rig(profile.find("ikns-finger")[1], {"sim.devices.mocap": {"noise": 0.0}}, 1, finger_calibration())
    rig.disturb = robustness_trial._swapped(rig, ["rwra", "rwrb"], True)
    labels = rig.lockstep.graph.layout.fields["mocap.markers"].labels
    a, b = labels.index("rwra"), labels.index("rwrb")
    own = rig.lockstep.graph.layout.fields["world.wearer_markers"].labels
    seen: list[bool] = []
    for _ in range(600):
        before = rig.views["world.wearer_markers"][own.index("RWRA")].copy()
        rig.step()
        points = rig.views["mocap.markers"]
        seen.append(bool(np.linalg.norm(points[b] - before) < np.linalg.norm(points[a] - before)))
    assert not any(seen[10:480])
    assert all(seen[520:])
    used = rig.views["arm.used"]
    assert used[[a, b]].tolist() == [-1.0, -1.0], "the law got them, and rejected them"


def test_a_condition_changes_what_it_says() -> None:
    """The profile takes every kind of option that the study gives, and the cameras see the difference."""
    text, calibration = profile.find("ikns-finger")[1], finger_calibration()

    def seen(given: dict[str, Any]) -> Array:
        rig = Rig(text, given, 1, calibration)
        for _ in range(20):
            rig.step()
        found: Array = rig.views["mocap.markers"].copy()
        return found

    base, kinds = seen({}), {c.what: c.parameters["set"] for c in robustness.conditions() if "set" in c.parameters}
    assert set(kinds) == {"marker noise", "torso", "slip"}
    for what, given in kinds.items():
        assert np.abs(seen(given) - base).max() > 1e-3, what


@pytest.mark.exhaustive
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_one_recording_gives_the_calibrations_of_any_of_its_dofs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relabelled samples: a set's calibration knows its own DoFs alone, in its own order."""
    monkeypatch.setattr("srl.studies.ikns.rig._EXPLORATION", 10.0)
    monkeypatch.setattr("srl.studies.ikns.rig._HELD", 3.5)
    calm = {"sim.parts.wearer.noise": 0.0, "sim.parts.wearer.wander": 0.0, "sim.parts.wearer.wander_turn": 0.0}
    rig = Rig(angles_alone(profile.find("ikns-two")[1]), calm, 1)
    done = instructed(rig, ("swivel", "protraction"))
    made, found = done.calibrated(("protraction", "swivel"))
    assert made.dofs == ("protraction", "swivel")
    assert found.crosstalk.shape == (10, 2, 2)
    # From peak to peak: the curvature of the motion alone makes 0.05 to 0.1.
    assert np.abs(found.crosstalk[:, 0, 1]).max() < 0.15
    one, _ = done.calibrated(("swivel",))
    assert one.dofs == ("swivel",)
    # The swivel goes farther than the clavicle, in the wearer and in the file alike.
    assert done.ranges[:, 0].mean() > done.ranges[:, 1].mean()


@pytest.mark.exhaustive
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_two_dofs_are_followed_at_once_better_than_by_standing_still(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dofs_trial, "SECONDS", 6.0)
    given: dict[str, Any] = {
        "set": {}, "dofs": ["swivel", "shrug"], "calibration": two_calibration(), "display": 0.02,
        "targets": ["T1", "T3"],
    }  # fmt: skip
    row = dofs_trial.tracking(profile.find("ikns-two")[1], given, 3)
    t = np.arange(0.0, 6.0, 0.01)
    for dof, name in (("swivel", "T1"), ("shrug", "T3")):
        still = 100.0 * np.sqrt(np.mean((dofs_trial.target(name, t) - dofs_trial.MIDDLE) ** 2))
        assert float(str(row[f"rmse_{dof}"])) < 0.5 * still
    assert float(str(row["leak_max"])) < 0.03


@pytest.mark.slow
def test_the_law_of_a_study_is_the_profiles_but_for_what_is_said() -> None:
    text = profile.find("ikns-two")[1]
    clamped = Rig(sensing(text), {}, 1, two_calibration())
    free = Rig(sensing(text, clamp=False), {}, 1, two_calibration())
    for rig in (clamped, free):
        rig.tell(Hold(POINT), 0.5)
    inside = np.clip(free.views["intent.c"], 0.0, 1.0)
    np.testing.assert_allclose(clamped.views["intent.c"], inside, atol=1e-12)


def test_a_study_without_values_claims_nothing() -> None:
    assert [claim.holds for claim in dofs._claims(["swivel+shrug"], [], [])] == [False] * 3


@pytest.mark.parametrize("name", ["calibration", "crosstalk", "noise", "tracking"])
def test_the_trials_are_registered(name: str) -> None:
    assert function(f"ikns-dofs-{name}") is getattr(dofs_trial, name)
