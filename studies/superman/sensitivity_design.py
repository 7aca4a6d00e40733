"""The points of the sensitivity study: persons and tasks spread evenly over wide ranges, and their trials."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from srl.studies.superman import drilling_trial, load_trial, peg_trial, wire_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import Person
from srl.studies.superman.persons import assumed as distributions
from srl.studies.tasks.task import TrialTask

STUDY: Final = "sensitivity"


@dataclass(frozen=True)
class Point:
    """One point of the design.

    Attributes:
        number: from 1; the seed of its trials.
        values: by parameter.
        person: somebody average with those values.
        task: assumptions of the peg's study that are other.
    """

    number: int
    values: Mapping[str, float]
    person: Person
    task: Mapping[str, float]


def points(count: int) -> list[Point]:
    """Returns the first `count` points of a scrambled Sobol sequence over the ranges of the assumptions."""
    from scipy.stats import qmc

    a = assumed(STUDY)
    ranges = {**a["person"], **a["task"]}
    # Two more dimensions: in which direction somebody aims beside, and tilts.
    sampler = qmc.Sobol(len(ranges) + 2, scramble=True, rng=np.random.default_rng(a["seed"]))
    found = []
    for number, row in enumerate(sampler.random(a["points"])[:count].tolist(), 1):
        *shares, aim, lean = row
        values = {name: _scaled(r, u) for (name, r), u in zip(ranges.items(), shares, strict=True)}
        task = {name: values[name] for name in a["task"]}
        found.append(Point(number, values, _person(number, values, math.tau * aim, math.tau * lean), task))
    return found


def _scaled(ranged: Mapping[str, Any], share: float) -> float:
    low, high = ranged["low"], ranged["high"]
    if ranged.get("log"):
        return float(low * (high / low) ** share)
    return float(low + (high - low) * share)


def _person(number: int, values: Mapping[str, float], aim: float, lean: float) -> Person:
    d = distributions()
    own = {name: values[name] for name in ("knowledge", "steering", "reward", "stiffness", "noise", "drift", "sight")}
    height = (d["height_man"]["mean"] + d["height_woman"]["mean"]) / 2
    return Person(
        name=f"Q{number:02}",
        height=height,
        mass=d["body_mass_index"]["mean"] * height**2,
        strength_high=values["strength"],
        strength_low=d["strength_low"] * values["strength"],
        tremor=d["tremor"]["median"],
        reaction=d["reaction"]["mean"],
        care=values["care"],
        bias_x=values["beside"] * math.cos(aim),
        bias_y=values["beside"] * math.sin(aim),
        tilt_x=values["tilted"] * math.cos(lean),
        tilt_y=values["tilted"] * math.sin(lean),
        **own,
    )


def tasks(chosen: Sequence[Point]) -> list[TrialTask]:
    """Returns the trials of the points: nine each, point by point, in the order of `NAMES`."""
    return [task for point in chosen for task in _of(point)]


NAMES: Final = (
    *(f"peg {label}" for label in peg_trial.CONDITIONS), "wire HR", "wire H", "drilling HR", "drilling H", "load",
)  # fmt: skip


def _of(point: Point) -> list[TrialTask]:
    a = assumed(STUDY)
    who = {"person": asdict(point.person)}

    def task(trial: str, profile: str, **given: Any) -> TrialTask:
        return TrialTask.of(STUDY, trial, point.number, {**who, "changed": {}, **given}, profile=profile)

    holes = {"HR": a["robot_holes"], "H": a["holes"]}
    return [
        *(
            task("superman-peg", c.profile, condition=c.label, changed=dict(point.task), series=False)
            for c in peg_trial.CONDITIONS.values()
        ),
        *(task("superman-wire", wire_trial.PROFILE, condition=c, changed={"marks": []}) for c in ("HR", "H")),
        *(
            task("superman-drilling", drilling_trial.PROFILES[c], condition=c, holes=holes)
            for c in ("HR", "H")
        ),
        task("superman-load", load_trial.PROFILE, short=True, series=False),
    ]  # fmt: skip
