"""The claims `no-blame` and `goals-reached`: what the verified stop is worth, and costs, beside one who looks away."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.studies.human_srl import goals_claims
from srl.studies.human_srl.contacts import BLAME
from srl.studies.human_srl.intervals import most, over_wearers, share
from srl.studies.human_srl.part import NAME, Part
from srl.studies.human_srl.reach_trial import SECONDS
from srl.studies.human_srl.setting import PROFILE
from srl.studies.human_srl.wearers import wearers
from srl.studies.result import Claim
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask

Rows = Sequence[Mapping[str, Any]]
ARMS: Final[dict[str, dict[str, Any]]] = {
    "no clearance": {"guarded": False},
    "body-clearance": {},
}
OFF, ON = ARMS
MOTIONS: Final = 200
PRICE: Final = 0.5  # the share of the goals that must be left, of those of an arm without a clearance; ours
_QUICK: Final = 2  # motions


def claims(runner: Runner, folder: Path, quick: bool) -> Part:
    """Runs the trials; see `part.py`."""
    asked = {arm: tasks(_QUICK if quick else MOTIONS, attack) for arm, attack in ARMS.items()}
    for arm, (attack, seconds) in goals_claims.ARMS.items():
        asked[arm] = tasks(_QUICK if quick else goals_claims.MOTIONS, attack, seconds)
    rows = runner.by_label(asked, folder / "reach")
    return analysed({arm: [plain(row.task, row.values) for row in own] for arm, own in rows.items()})


def tasks(count: int, attack: Mapping[str, Any], seconds: float = SECONDS) -> list[TrialTask]:
    """The first motions, those of all wearers in turn: motion k is that of wearer k, k - 50 and so on."""
    who = [asdict(one) for one in wearers()]
    return [
        TrialTask.of(
            NAME, "human-srl-reach", seed,
            {"wearer": who[(seed - 1) % len(who)], "attack": dict(attack), "seconds": seconds}, profile=PROFILE,
        )
        for seed in range(1, count + 1)
    ]  # fmt: skip


def plain(task: TrialTask, values: Mapping[str, Any]) -> dict[str, Any]:
    """What the analysis needs of a row."""
    who, seconds = task.parameters["wearer"]["name"], task.parameters["seconds"]
    return {"motion": task.seed, "wearer": who, "seconds": seconds, **values}


def analysed(rows: Mapping[str, Rows]) -> Part:
    """Judges the claims by rows of each of `ARMS`, of which motions that one lacks are left out of both, and of those
    of `goals_claims`."""
    long, still = (rows.get(arm, []) for arm in goals_claims.ARMS)
    rows = {arm: rows[arm] for arm in ARMS}
    both = set.intersection(*({row["motion"] for row in own} for own in rows.values()))
    rows = {arm: [row for row in own if row["motion"] in both] for arm, own in rows.items()}
    if not both:
        return Part([_unmeasured(name) for name in ("no-blame", "goals-reached", *goals_claims.LEAST)])
    table = [line({"arm": arm, "wearer": "all"}, own) for arm, own in rows.items()]
    for arm in (OFF, ON):
        for words, beyond in (("within a_e", False), ("quicker", True)):
            if chosen := [row for row in rows[arm] if (row["beyond"] > 1.0) == beyond]:
                table.append(line({"arm": arm, "wearer": words}, chosen))
    for arm, own in ((goals_claims.LONG, long), (goals_claims.STILL, still)):
        if own:
            table.append(line({"arm": arm, "wearer": "all"}, own))
    further = goals_claims.claims(rows[ON], long, still, rows[OFF])
    return Part([_no_blame([*rows[ON], *long, *still], rows[OFF]), _goals(rows), *further], table)


def line(first: Mapping[str, Any], rows: Rows) -> dict[str, Any]:
    """A row of the table, with bounds at 95 %: exact ones of the motions, intervals over the wearers of the goals."""
    n = len(rows)
    counted = ("contacts", "rest", "blamed", "blamed_left_out", "pushed")
    total = {name: sum(int(row[name]) for row in rows) for name in counted}
    guilty = sum(bool(row["blamed"] or row["blamed_left_out"]) for row in rows)
    tried, reached = (sum(int(row[name]) for row in rows) for name in ("tried", "reached"))
    low, high = over_wearers(rows, ("reached", "tried"), share)
    return {
        "part": "reach",
        **first,
        "motions": n,
        "contacts": total["contacts"],
        "at rest": total["rest"],
        "blamed": total["blamed"],
        "blamed, left out": total["blamed_left_out"],
        "pushed": total["pushed"],
        "motions with blame": guilty,
        "at most, %": 100.0 * most(guilty, n) if n else None,
        "fastest, m/s": max((float(row["fastest"]) for row in rows), default=0.0),
        "goals tried": tried,
        "reached, %": 100.0 * reached / tried if tried else None,
        "low": 100.0 * low,
        "high": 100.0 * high,
        "a minute": 60.0 * reached / sum(float(row["seconds"]) for row in rows) if n else None,
        "held, %": 100.0 * float(np.mean([row["held"] for row in rows])) if n else None,
        "m/s2": max((float(row["acceleration"]) for row in rows), default=0.0),
    }


def _no_blame(on: Rows, off: Rows) -> Claim:
    blamed = sum(int(row["blamed"]) + int(row["blamed_left_out"]) for row in on)
    guilty = sum(bool(row["blamed"] or row["blamed_left_out"]) for row in on)
    quick = sum(row["beyond"] > 1.0 for row in on)
    without = sum(int(row["blamed"]) + int(row["blamed_left_out"]) for row in off)
    guilty_without = sum(bool(row["blamed"] or row["blamed_left_out"]) for row in off)
    contacts, rest, pushed = (sum(int(row[name]) for row in on) for name in ("contacts", "rest", "pushed"))
    pushed_without = sum(int(row["pushed"]) for row in off)
    return Claim(
        id="no-blame",
        text=f"with the verified stop the arm approaches at over {BLAME:g} m/s in no contact that begins; {len(on)} "
        f"motions of {len({row['wearer'] for row in on})} wearers, {quick} of them quicker than the clearance takes "
        f"for possible: in {guilty} motions, so at most {100.0 * most(guilty, len(on)):.2g} % at 95 %; of {contacts} "
        f"contacts of pairs that are compared {rest} began at an arm at rest; into {pushed} contacts it went so fast "
        f"then or later; without it {without} contacts in {guilty_without} motions, into {pushed_without} then or "
        "later; measured: contacts",
        paper="", measured=float(blamed), unit="", holds=blamed == 0,
    )  # fmt: skip


def _goals(rows: Mapping[str, Rows]) -> Claim:
    together = [
        {
            "wearer": a["wearer"], "reached": a["reached"], "tried": a["tried"],
            "reached off": b["reached"], "tried off": b["tried"],
        }
        for a, b in zip(rows[ON], rows[OFF], strict=True)
    ]  # fmt: skip
    columns = ("reached", "tried", "reached off", "tried off")
    sums = np.array([[float(row[name]) for name in columns] for row in together]).sum(axis=0)
    low, high = over_wearers(together, columns, _ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = float(_ratio(sums))
        shares = ", ".join(f"{100.0 * a / b:.0f} % of {b:.0f}" for a, b in sums.reshape(2, 2))
    words = ""
    if slower := _slower(rows):
        words = (
            f"; of {len(slower)} first goals that both reach, it takes {np.median(slower):.2f} times as long (median)"
        )
    return Claim(
        id="goals-reached",
        text=f"with the verified stop the arm reaches at least {100 * PRICE:g} % of the share of goals that it "
        f"does without ({shares}), "
        f"beside a person who never gives way: 95 % interval over wearers {low:.2f} to {high:.2f}"
        f"{words}; measured: the shares' ratio",
        paper="", measured=found if np.isfinite(found) else None, unit="", holds=low >= PRICE,
    )  # fmt: skip


def _ratio(sums: Array) -> Array:
    found: Array = (sums[..., 0] / sums[..., 1]) / (sums[..., 2] / sums[..., 3])
    return found


def _slower(rows: Mapping[str, Rows]) -> list[float]:
    """How many times as long a motion's first goal takes, where it is reached with and without the clearance."""
    found = []
    for on, off in zip(rows[ON], rows[OFF], strict=True):
        first = [(json.loads(str(row["times"])) or [None])[0] for row in (on, off)]
        if first[0] is not None and first[1] is not None:
            found.append(first[0] / first[1])
    return found


def _unmeasured(claim: str) -> Claim:
    return Claim(id=claim, text="no motion has all its trials", paper="", measured=None, unit="", holds=False)
