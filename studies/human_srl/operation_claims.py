"""The claims `independent-...`: what a task that the arm does by itself is worth, and what the verified stop costs.

Every wearer's arm does one path of its own, once beside the wearer who stands still, and once beside the same wearer
who reaches about with both arms all the time and doesn't look; with and without the verified stop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.models.skeleton.arms import BASE as STANDARD
from srl.studies.human_srl.operation_trial import PROFILE
from srl.studies.human_srl.part import NAME, Part
from srl.studies.human_srl.wearers import Wearer, wearers
from srl.studies.result import Claim
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask
from srl.studies.toolkit.estimates import estimate
from srl.studies.toolkit.statistics import proportion, tost

MARGIN: Final = 2.0  # mm: errors that differ by less are taken as equivalent; a tip of the arm is 60 mm thick
_QUICK, _QUICK_SECONDS, _SWEPT = 1, 10.0, 4
STILL, MOVING = "still, verified stop", "moving, verified stop"
# What differs between the conditions, beside the person's motion and the verified stop: the law's own keeping clear.
CONDITIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    STILL: {"still": True},
    "still, no stop": {"still": True, "guarded": False},
    MOVING: {},
    "moving, no stop": {"guarded": False},
    "moving, no stop, law ignores the body": {"guarded": False, "replay": {"around": "ignore"}},
}


def claims(runner: Runner, folder: Path, quick: bool) -> Part:
    """Runs the trials and judges the claims; `quick`: one wearer, given up after 10 s."""
    return study(runner, folder, wearers(_QUICK), most=_QUICK_SECONDS) if quick else study(runner, folder, wearers())


def study(runner: Runner, folder: Path, who: Sequence[Wearer], **changed: Any) -> Part:
    """Runs the trials of these wearers. `changed`: as in `task`."""
    asked = [task(one, name, **changed) for one in who for name in CONDITIONS]
    return analysed(runner.done(asked, folder / "operation"))


def task(one: Wearer, condition: str, **changed: Any) -> TrialTask:
    """One trial. `changed`: fields of `operation_trial.Case`."""
    parameters = {"condition": condition, "wearer": asdict(one), "case": {**CONDITIONS[condition], **changed}}
    return TrialTask.of(NAME, "human-srl-operation", one.number, parameters, profile=PROFILE)


def analysed(rows: Sequence[Row]) -> Part:
    """Judges the rows of `claims`."""
    by = {name: [row for row in rows if row.task.parameters["condition"] == name] for name in CONDITIONS}
    table = [{"part": "operation", "condition": name} | line(own) for name, own in by.items() if own]
    return Part([_error(by), _done(by[MOVING]), _blame(by)], table, ["operation/rows.parquet"])


def line(rows: Sequence[Row]) -> dict[str, Any]:
    """One condition's line of the table: means over wearers with intervals; contacts counted.

    `time_s` is that of the paths that were done.
    """
    found: dict[str, Any] = {"n": len(rows)}
    for name, column in (("mean", "error_mm"), ("p95", "p95_mm")):
        found |= estimate([row.number(name) for row in rows]).columns(column)
    found["most_mm"] = max((row.number("most") for row in rows), default=math.nan)
    done = [row for row in rows if row.values["done"]]
    found |= estimate([row.number("taken") for row in done]).columns("time_s")
    low, high = proportion(len(done), len(rows)) if rows else (math.nan, math.nan)
    found |= {"done": len(done), "done_low": low, "done_high": high}
    found |= {name: sum(int(row.number(name)) for row in rows) for name in ("contacts", "blamed")}
    found["fastest_blamed"] = max((row.number("fastest") for row in rows if row.values["blamed"]), default=math.nan)
    return found


def _error(by: Mapping[str, Sequence[Row]]) -> Claim:
    own = {
        name: {row.task.seed: row.number("mean") for row in by[name] if math.isfinite(row.number("mean"))}
        for name in (STILL, MOVING)
    }
    both = sorted(own[STILL].keys() & own[MOVING].keys())
    still, moving = ([own[name][n] for n in both] for name in (STILL, MOVING))
    text = (
        f"behind the verified stop the tip's error is the same beside a person who moves and one who stands still: "
        f"means over {len(both)} simulated wearers differ by less than {MARGIN:g} mm"
    )
    holds = False
    if len(set(np.subtract(moving, still).tolist())) > 2:
        same = tost(moving, still, MARGIN)
        holds = same.equivalent
        text += (
            f" (TOST, p = {same.p:.2g}, difference {same.difference:.2f}, 90 % interval {same.low:.2f} to "
            f"{same.high:.2f}); still {estimate(still)} mm; measured: beside a person who moves"
        )
    return Claim(
        id="independent-tip-error", text=text, paper="none; left to future work",
        measured=float(np.mean(moving)) if both else None, unit="mm", holds=holds,
    )  # fmt: skip


def _done(rows: Sequence[Row]) -> Claim:
    done, n = sum(bool(row.values["done"]) for row in rows), len(rows)
    low, high = proportion(done, n) if n else (math.nan, math.nan)
    return Claim(
        id="independent-done",
        text="beside a person who moves all the time, and behind the verified stop, more than 9 of 10 paths of 5 s are "
        f"done within a minute: {done} of {n}, exact 95 % interval {100 * low:.0f} to {100 * high:.0f} %, above 90 %",
        paper="none", measured=100.0 * done / n if n else None, unit="%", holds=low > 0.9,
    )  # fmt: skip


def _blame(by: Mapping[str, Sequence[Row]]) -> Claim:
    guarded = [*by[STILL], *by[MOVING]]
    blamed = sum(int(row.number("blamed")) for row in guarded)
    paths = sum(row.number("blamed") > 0 for row in guarded)
    high = proportion(paths, len(guarded))[1] if guarded else math.nan
    bare = sum(int(row.number("blamed")) for name, rows in by.items() if "no stop" in name for row in rows)
    return Claim(
        id="independent-no-blame",
        text=f"behind the verified stop no contact began in which the arm closed the gap at over 0.02 m/s, in "
        f"{len(guarded)} paths (up to {100 * high:.1f} % of paths, exact 95 % interval); without it {bare}",
        paper="none", measured=float(blamed) if guarded else None, unit="contacts", holds=bool(guarded) and not blamed,
    )  # fmt: skip


def sweep(runner: Runner, folder: Path) -> list[dict[str, Any]]:
    """What decides: one thing changed at a time, beside a person who moves, for the first wearers."""
    who = wearers(_SWEPT)
    asked = {label: [task(one, MOVING, **changed) for one in who] for label, changed in _changes()}
    rows = runner.by_label(asked, folder / "sweep-operation")
    return [
        {"claim": "independent-tip-error", "changed": label} | (line(own) if own else {}) for label, own in rows.items()
    ]


def _changes() -> Iterator[tuple[str, dict[str, Any]]]:
    """In words, and as fields of a case."""
    yield "nothing", {}
    yield "the law waits on the path", {"replay": {"around": "wait"}}
    yield "the law keeps 0.12 m (0.06)", {"replay": {"keep": 0.12}}
    yield "the law ignores the body", {"replay": {"around": "ignore"}}
    yield "the person half as quick", {"pace": 0.5}
    yield "the person twice as quick", {"pace": 2.0}
    yield "servos 60 ms late (30), told", {"lag": 0.06}
    yield "servos without lag", {"lag": 0.0}
    yield "suit may be off by 0.05 m all the time, declared", {"clear": {"uncertainty": 0.05, "noise": 0.0}}
    yield "body accelerates half as fast", {"clear": {"acceleration": 0.5}}
    yield "arm's base as in human-srl", {"base": [-0.15, 0.05, 0.35]}
    yield "arm's base as the standard one", {"base": list(STANDARD)}
