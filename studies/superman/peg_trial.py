"""One trial of constrained interaction: a person leads a peg into a hole and out again, with MOCA or Kairos (Fig. 11).

"As published" is the paper's law without the runtime's additions (leash, tank, slowing down).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, turned
from srl.runtime.contracts.signals import Array
from srl.sim.parts.person.plans import peg_in_hole
from srl.studies.simulated import Run, Setup, controllers, largest, simulate, without_hand
from srl.studies.superman import user_trial
from srl.studies.superman.as_published import as_published
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import Person
from srl.studies.tasks.task import Value

STUDY: Final = "peg-in-hole"
SIGNALS: Final = (
    "world.hole_force", "world.hole_depth", "world.person_progress", "world.person_tool", "guide.pose", "tool.pose",
)  # fmt: skip
POINTS: Final = 500  # of the series that a figure shows
# Hand, sensor and handle of the profiles: kg, and m in the flange's frame.
_FLANGE: Final = (0.88, (0.05, 0.003, 0.065))


@dataclass(frozen=True)
class Condition:
    """A robot and its law. `bare`: as published."""

    label: str
    profile: str
    bare: bool

    @property
    def robot(self) -> str:
        return "moca" if self.profile == "moca-man" else "kairos"


MOCA: Final = Condition("MOCA", "moca-man", bare=False)
MOCA_BARE: Final = Condition("MOCA as published", "moca-man", bare=True)
KAIROS_BARE: Final = Condition("Kairos as published", "kairos-man", bare=True)
COMPLIANT: Final = Condition("Kairos, force feedback", "kairos-man", bare=False)
CONDITIONS: Final = {c.label: c for c in (MOCA, MOCA_BARE, KAIROS_BARE, COMPLIANT)}


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One person with one robot and law.

    Args:
        text: of the condition's profile.
        parameters: `person`, of `Person` by name; `condition`, a label of `CONDITIONS`; `changed`, assumptions that are
            other; `series`, whether the row has what a figure shows.
        seed: of the world.

    Returns:
        see `read`.
    """
    a = assumed(STUDY) | parameters["changed"]
    condition, person = CONDITIONS[parameters["condition"]], Person(**parameters["person"])
    run = simulate(text, setup(text, person, condition, a), seed, SIGNALS)
    row = read(run, condition, person, a)
    return row | {"series": series(run, condition, a) if parameters["series"] else ""}


def setup(text: str, person: Person, condition: Condition, a: dict[str, Any]) -> Setup:
    """Returns a run of one condition, with the assumptions `a`."""
    tilt = person.tilt_at(a[f"flange_quaternion_{condition.robot}"])
    mass, at = _with_peg(a, tilt)
    arm: dict[str, Any] = {"load": {"mass": mass, "centre": at}}
    if condition.robot == "kairos":
        arm = {"payload": mass, "payload_cog": at}
    steps = peg_in_hole(depth=a["depth"], force=a["push"], above=a["above"])
    changes: dict[str, Any] = {
        "devices": {"arm": arm, "hand": None},
        "controllers": without_hand(_controllers(text, condition, a)),
        "guard": {"hand.position_command": None},
        "stop": {"hand": None},
        "sim": {
            "ends_with": "person",
            "parts": {
                "peg": {
                    "part": "peg",
                    "at": {"parent": "arm/flange", "position": a["peg_position"], "quaternion": list(tilt)},
                    "mass": a["peg_mass"], "length": a["peg_length"],
                },
                "hole": {
                    "part": "hole", "at": {"position": a[f"hole_{condition.robot}"]}, "peg": "peg/tip",
                    "diameter": a["diameter"], "chamfer": a["chamfer"],
                    "stiffness": a["contact"], "friction": a["friction"],
                },
                "person": person.options() | {
                    "tool": "peg/tip", "plan": user_trial.plan(steps, a["patience"]),
                    "learned_mass": a["mass"][0], "learned_damping": a["damping"][0],
                },
            },
        },
    }  # fmt: skip
    if condition.robot == "kairos":
        changes["sim"]["devices"] = {"arm": {"force_limit": a["force_limit"]}}
        changes["sim"]["parts"]["arm"] = {"drives": a["drives"]}
    return Setup(condition.profile, changes, a["duration"])


def _with_peg(a: dict[str, Any], tilt: Quaternion) -> tuple[float, list[float]]:
    """Returns the kg at the flange with the peg, and its centre of mass, as configured in the robot."""
    mass, centre = _FLANGE
    peg = [p + v for p, v in zip(a["peg_position"], turned(tilt, (0.0, 0.0, a["peg_length"] / 2)), strict=True)]
    total = mass + a["peg_mass"]
    return total, [(mass * c + a["peg_mass"] * p) / total for c, p in zip(centre, peg, strict=True)]


def _controllers(text: str, condition: Condition, a: dict[str, Any]) -> list[dict[str, Any]]:
    options: dict[str, Any] = {"mass": a["mass"], "damping": a["damping"]}
    entries = controllers(text, "guide", **options)
    return as_published(entries) if condition.bare else entries


def read(run: Run, condition: Condition, person: Person, a: dict[str, Any]) -> dict[str, Value]:
    """Returns the outcome, from the run's ground truth. Forces in N, lengths in mm.

    `force` is the largest of single cycles. The simulated contact chatters, so a sensor would show less; `mean_force`
    is the largest mean over the stated window. The claims use `force`. `withdrew`: inserted, and out again without a
    stop. `beside` and `tilted` (degrees) are the person's.
    """
    force, depth = run.value("world.hole_force"), run.value("world.hole_depth")[:, 0]
    progress = run.value("world.person_progress")
    # After the insertion and the rest comes the withdrawal: step 4 of the plan. The peg is out after it.
    above = run.value("world.person_tool")[:, 2] - a[f"hole_{condition.robot}"][2]
    inserted = bool(depth.max(initial=0.0) >= a["inserted"])
    out = progress[:, 0] >= 5
    return {
        "force": round(largest(force), 3),
        "mean_force": round(largest(smoothed(force, run.t, a["window"])), 3),
        "depth": round(1e3 * float(depth.max()), 3),
        "inserted": inserted,
        "withdrew": inserted and not run.cause and bool(out.any()) and bool(above[out][0] > 0.0),
        "missed": int(progress[-1, 1]),
        "stop": run.cause,
        "stopped_at": run.stopped_at,
        "beside": round(1e3 * float(np.hypot(person.bias_x, person.bias_y)), 3),
        "tilted": round(float(np.degrees(np.hypot(person.tilt_x, person.tilt_y))), 3),
    }


def smoothed(values: Array, t: Array, window: float) -> Array:
    """Returns running means (k, 3) of values (k, 3) over the last `window` s."""
    n = max(1, round(window / float(np.median(np.diff(t)))))
    total = np.cumsum(np.vstack([np.zeros((n, values.shape[1])), values]), axis=0)
    return np.asarray((total[n:] - total[:-n]) / n)


def series(run: Run, condition: Condition, a: dict[str, Any]) -> str:
    """Returns what the figure shows, as JSON: lists by name, thinned out; of forces the largest of each span.

    Names: t (s), force, mean (N), tip and desired (k, 3), mm from the hole's mouth.
    """
    every = max(1, len(run.t) // POINTS)
    n = len(run.t) // every * every
    hole = np.array(a[f"hole_{condition.robot}"])
    force, tip = run.value("world.hole_force"), run.value("world.person_tool")
    desired = run.value("guide.pose")[:, :3] + tip - run.value("tool.pose")[:, :3]

    def most(values: Array) -> list[float]:
        size = np.linalg.norm(values, axis=1)[:n].reshape(-1, every).max(axis=1)
        return [round(v, 2) for v in size.tolist()]

    def thin(values: Array) -> list[list[float]]:
        return np.round((values[:n:every] - hole) * 1e3, 2).tolist()

    found = {
        "t": np.round(run.t[:n:every], 4).tolist(), "force": most(force),
        "mean": most(smoothed(force, run.t, a["window"])), "tip": thin(tip), "desired": thin(desired),
    }  # fmt: skip
    return json.dumps(found)
