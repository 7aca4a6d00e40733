"""Long-distance load carrying (Giammarino et al. 2022, section IV-B2, Fig. 14): Kairos, 10 kg, past obstacles."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts.gravity import GRAVITY
from srl.studies.result import Claim, Result
from srl.studies.superman import persons as people
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.load_figure import draw
from srl.studies.superman.load_trial import PROFILE, STUDY, shortened
from srl.studies.superman.persons import COUNT, persons
from srl.studies.superman.shares import share
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask
from srl.studies.toolkit.estimates import Estimate, estimate

TRIAL: Final = "superman-load"
Row = Mapping[str, Any]
_QUICK: Final = 1  # persons
# The times in s of the paper's Fig. 14, taken from its text.
PAPER: Final = {"before": "0 to 35", "lifting": "35 to 38", "carrying": "38 to 80", "placing": "80 to 82"}


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs the study. `quick`: one person, and only the first metre of the path, with the place of delivery beside."""
    rows = runner.done(tasks(_QUICK if quick else COUNT, short=quick), folder / "trials")
    found: list[Row] = [row.values for row in rows]
    a = shortened(assumed(STUDY)) if quick else assumed(STUDY)
    result = Result(STUDY, simulated=True, seeds=[people.assumed()["seed"]], claims=claims(found, a))
    result.table = table(found, a)
    if shown := next((row for row in found if row["series"]), None):
        draw(shown, json.loads(str(shown["series"])), a, folder / "load-carrying.png")
        result.files = ["load-carrying.png"]
    return result


def tasks(count: int, *, short: bool) -> list[TrialTask]:
    """Returns a trial of each person; the first one's row has what the figure shows."""
    return [
        TrialTask.of(
            STUDY, TRIAL, person.number,
            {"person": asdict(person), "short": short, "changed": {}, "series": person.number == 1}, profile=PROFILE,
        )
        for person in persons(count)
    ]  # fmt: skip


def carried(row: Row, a: Mapping[str, Any]) -> bool:
    """Whether the load was carried to its place, and stands there upright."""
    return bool(
        row["placed"] is not None
        and row["lifted"] is not None
        and row["stands"]
        and not row["stop"]
        and row["off"] <= a["tolerance"]
        and row["tilt"] <= a["upright"]
    )


def modes(row: Row) -> bool:
    """Whether the load was taken and let go in manipulation, and carried in locomotion."""
    through = row["placed"] is not None and row["lifted"] is not None
    return bool(through and min(row["manipulation"], row["locomotion"]) > 0)


def claims(found: Sequence[Row], a: Mapping[str, Any]) -> list[Claim]:
    """Returns the paper's statements, and whether they held.

    Those about a trial hold if the 95 % interval of the share of persons who confirm them is above a half; that about
    the force if its mean's interval lies within the tolerance.
    """
    tolerance, expected, within = a["tolerance"], -GRAVITY * a["mass"], a["force_within"]
    force = _over(found, "force_z")
    off, least = _over(found, "off"), _over(found, "least")
    return [
        share([carried(row, a) for row in found]).claim(
            "load-carried",
            f"picked in manipulation, carried in locomotion, placed within {tolerance} m, upright; off by {off} m",
            "accomplished",
        ),
        Claim(
            id="load-force",
            text=f"f_z at the flange while carried is the load's {expected:.1f} N, within {within:g} N: {force}",
            paper="approximately -100 N",
            measured=force.mean if force.n else None,
            unit="N",
            holds=force.n > 1 and expected - within <= force.low and force.high <= expected + within,
        ),
        share([row["touches"] == 0 and row["least"] > 0 for row in found]).claim(
            "obstacles-clear",
            f"base, arm, hand and load never touch an obstacle; least distance {least} m, "
            f"of all {min((row['least'] for row in found), default=float('nan')):.3f} m",
            "static obstacles successfully avoided",
        ),
        share([modes(row) for row in found]).claim(
            "both-modes", "taken and let go in manipulation, carried in locomotion", "both phases"
        ),
    ]


def _over(found: Sequence[Row], name: str) -> Estimate:
    """The mean of a figure over those who have it."""
    return estimate([row[name] for row in found if row[name] is not None])


def table(found: Sequence[Row], a: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the table's rows: what, the paper's value, ours as mean and 95 % interval."""

    def span(first: str | None, last: str) -> str:
        """Mean length of a phase."""
        both = [row for row in found if row[last] is not None and (first is None or row[first] is not None)]
        return str(estimate([row[last] - (0.0 if first is None else row[first]) for row in both]))

    rows = [
        ("load (kg)", "10", a["mass"]),
        ("persons", "1", len(found)),
        ("before the grasp, lasts (s)", PAPER["before"], span(None, "taken")),
        ("grasp and lift (s)", PAPER["lifting"], span("taken", "lifted")),
        ("carrying (s)", PAPER["carrying"], span("lifted", "lowered")),
        ("placing (s)", PAPER["placing"], span("lowered", "placed")),
        ("f_z while carried, mean (N)", "about -100", str(_over(found, "force_z"))),
        ("  its standard deviation (N)", None, str(_over(found, "spread"))),
        ("  without the hand's part (N)", None, str(_over(found, "net"))),
        ("greatest force while held (N)", None, str(_over(found, "strongest"))),
        ("load's way (m)", None, str(_over(found, "way"))),
        ("placed off by (m)", None, str(_over(found, "off"))),
        ("tilt when placed (rad)", None, str(_over(found, "tilt"))),
        ("persons whose robot stopped", None, sum(bool(row["stop"]) for row in found)),
        ("persons who touched an obstacle", "0", sum(row["touches"] > 0 for row in found)),
        ("least distance to an obstacle (m)", None, str(_over(found, "least"))),
        ("steps of the plan missed", None, str(_over(found, "missed"))),
    ]
    return [{"": what, "paper (Fig. 14)": paper, "simulated": ours} for what, paper, ours in rows]
