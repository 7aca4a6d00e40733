"""The study of the watched payload: its rigid body, one trial of each kind, and what its claims say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from srl.runtime.profile import profile
from srl.studies.superman import payload as study
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.payload_trial import Course, Sensed, contact, drop, guide
from srl.studies.tasks.task import Row, TrialTask

TEXT = profile.find("kairos-man")[1]


def setup(**changes: Any) -> dict[str, Any]:
    return assumed("payload") | changes


def test_the_trials_rigid_body_is_pinocchios() -> None:
    sensed = Sensed(TEXT, setup(), 3)
    rng = np.random.default_rng(2)
    turn, (a, w, z) = Rotation.random(random_state=rng), rng.normal(0, 2, (3, 3))
    rows = (v[None] for v in (np.zeros(3), np.zeros(3), a))
    c = Course(*rows, Rotation.from_quat(turn.as_quat()[None]), w[None], z[None])
    found = sensed.pull(c, sensed.mass, sensed.com, sensed.inertia)[0]
    R = turn.as_matrix()
    body = pin.Inertia(sensed.mass, R @ sensed.com, R @ sensed.inertia @ R.T)
    spin = pin.Motion(np.zeros(3), w)
    true = -(body * pin.Motion(a - np.array([0, 0, -9.81]), z) + spin.cross(body * spin)).vector
    np.testing.assert_allclose(found, true, atol=1e-9)


@pytest.mark.slow
def test_a_trial_of_each_kind() -> None:
    given = {"setup": setup()}
    free = guide(TEXT, given | {"seconds": 1.0}, 1)
    assert free["carrying"]
    assert (free["stops"], free["contacts"]) == (0, 0)
    assert abs(float(free["mass_error"] or 0)) < 0.6
    hit = contact(TEXT, given | {"where": "above", "speed": 0.25, "stiffness": 2e4}, 1)
    assert 0 < float(hit["seen"] or 0) < float(hit["stopped"] or 0) < 0.06
    assert float(hit["peak"] or 0) > float(hit["force"] or 0) > 40.0
    fallen = drop(TEXT, given, 1)
    assert float(fallen["gone"] or 9) < 0.05
    assert (fallen["drops"], fallen["stops"]) == (1, 0)


def rows() -> list[Row]:
    guided = {"hours": 4.0, "stops": 0, "contacts": 0, "force": 5.0, "torque": 1.0, "mass_error": 0.1, "deviation": 0.3}
    values = {
        "guide": guided | {"com_error": 0.01},
        "contact": {"seen": 0.01, "stopped": 0.03, "force": 60.0, "peak": 90.0},
        "drop": {"gone": 0.02},
    }
    return [
        Row("", task, "", "done", values[task.trial.removeprefix("payload-")], "", 0.0, "", {})
        for task in study.tasks(setup(), [1], 1.0)
    ]


def holding(found: list[Row]) -> set[str]:
    return {claim.id for claim in study.claims(found) if claim.holds}


def changed(found: list[Row], kind: str, **values: Any) -> list[Row]:
    return [replace(row, values=row.values | values) if row.task.trial == f"payload-{kind}" else row for row in found]


@pytest.mark.parametrize(
    ("claim", "kind", "values"),
    [
        ("false-stops", "guide", {"stops": 2}),
        ("false-stops", "guide", {"hours": 0.5}),
        ("contact-stops", "contact", {"stopped": None}),
        ("slow-contact-below-hand", "contact", {"peak": 141.0}),
        ("drop-seen", "drop", {"gone": None}),
        ("mass-as-stated", "guide", {"mass_error": -0.7}),
    ],
)
def test_a_claim_fails_of_trials_that_went_otherwise(claim: str, kind: str, values: dict[str, Any]) -> None:
    assert claim in holding(rows())
    assert claim not in holding(changed(rows(), kind, **values))


def test_zero_stops_in_three_hours_bound_the_rate_by_one_an_hour() -> None:
    assert study.upper(0, 3.0) == pytest.approx(-np.log(0.05) / 3.0)


def test_its_tasks_are_plain_and_differ() -> None:
    found = list(study.tasks(setup(), [1, 2], 5.0))
    assert len({task.identity for task in found}) == len(found) == 2 * (2 + 3 * 2 * 2)
    assert all(isinstance(task, TrialTask) and task.text for task in found)
