"""Judges the applications: successes with intervals, and arms against each other on the same seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from srl.studies.grasp.starts import UNUSABLE
from srl.studies.result import Claim
from srl.studies.tasks.task import Row
from srl.studies.toolkit.statistics import holm, proportion, sign_test

_LEVEL: Final = 0.05

Records = Mapping[tuple[str, str], Mapping[int, Mapping[str, Any]]]


def records(rows: Iterable[Row]) -> dict[tuple[str, str], dict[int, Mapping[str, Any]]]:
    """The values by scene and arm, and seed."""
    found: dict[tuple[str, str], dict[int, Mapping[str, Any]]] = {}
    for row in rows:
        at = row.task.parameters
        own = found.setdefault((at["scene"], at["arm"]), {})
        if row.done:
            own[row.task.seed] = row.values
    return found


def table(found: Records) -> list[dict[str, Any]]:
    """A line for each scene and arm: successes, Wilson's interval, why the others failed, what the object did."""
    return [_line(scene, arm, list(own.values())) for (scene, arm), own in found.items() if _begun(own)]


def _begun(rows: Mapping[int, Mapping[str, Any]]) -> dict[int, Mapping[str, Any]]:
    """Without the seeds at which an arm can't even begin: they say nothing about it."""
    return {seed: values for seed, values in rows.items() if values["reason"] != UNUSABLE}


def _line(scene: str, arm: str, tried: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    rows = [row for row in tried if row["reason"] != UNUSABLE]
    good = [row for row in rows if row["success"]]
    low, high = proportion(len(good), len(rows), method="wilson")
    reasons = Counter(str(row["reason"]) for row in rows if not row["success"])

    def share(closing: str) -> str:
        own = [row["success"] for row in rows if row["closing"] == closing]
        return f"{sum(own)}/{len(own)}"

    return {
        "scene": scene, "arm": arm, "successes": len(good), "of": len(rows), "low": low, "high": high,
        "unusable": len(tried) - len(rows),
        "curl": share("curl"), "converge": share("converge"),
        "pushed mm": 1e3 * float(np.median([row["pushed"] for row in rows])),
        "slip mm": 1e3 * float(np.median([row["slip"] for row in good])) if good else None,
        "force N": float(np.median([row["force"] for row in good])) if good else None,
        "first link": float(np.median([row["root"] for row in good])) if good else None,
        "failures": ", ".join(f"{reason} {n}" for reason, n in reasons.most_common()),
    }  # fmt: skip


def compared(found: Records, scene: str, arm: str, other: str) -> dict[str, Any]:
    """Two arms on the seeds that both have: how many only one of them did, and McNemar's exact p, two-sided."""
    one, two = _begun(found.get((scene, arm), {})), _begun(found.get((scene, other), {}))
    seeds = sorted(one.keys() & two.keys())
    if not seeds:
        return {"scene": scene, "arm": arm, "against": other, "pairs": 0, "only": 0, "only against": 0, "p": 1.0}
    first, second = ([float(own[seed]["success"]) for seed in seeds] for own in (one, two))
    test = sign_test(first, second)
    return {
        "scene": scene, "arm": arm, "against": other, "pairs": len(seeds), "only": test.more,
        "only against": test.less, "p": test.p,
    }  # fmt: skip


@dataclass(frozen=True)
class Asked:
    """A claim before it is judged: in `scene`, `arm` succeeds more often than `other`; `paper`: what the paper says."""

    id: str
    scene: str
    arm: str
    other: str
    paper: str


def verdicts(found: Records, asked: Sequence[Asked]) -> list[Claim]:
    """Claims hold if McNemar's test says so at 5 % after Holm's correction for their number."""
    pairs = [compared(found, one.scene, one.arm, one.other) for one in asked]
    corrected = holm([pair["p"] for pair in pairs])
    return [_verdict(one, pair, p) for one, pair, p in zip(asked, pairs, corrected, strict=True)]


def _verdict(asked: Asked, pair: Mapping[str, Any], p: float) -> Claim:
    lead = (pair["only"] - pair["only against"]) / pair["pairs"] if pair["pairs"] else None
    words = (
        f"{asked.scene}: {asked.arm} succeeds more often than {asked.other} ({pair['only']} pairs only {asked.arm}, "
        f"{pair['only against']} only {asked.other}, of {pair['pairs']}; McNemar's exact p = {pair['p']:.2g}, Holm's "
        f"{p:.2g})"
    )
    return Claim(
        id=asked.id, text=words, paper=asked.paper, measured=lead and 100.0 * lead, unit="percentage points",
        holds=pair["only"] > pair["only against"] and p < _LEVEL,
    )  # fmt: skip
