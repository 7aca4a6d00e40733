"""Judges the grasping experiment: claims, a table beside the paper's, statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final

from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns.published import GRASPS, MEDIAN_INCREASE, SECONDS
from srl.studies.result import Claim
from srl.studies.toolkit.statistics import SignTest, proportion, sign_test, summary

_LEVEL: Final = 0.05
_CONDITIONS: Final = ("ikns", "ring")


def analysed(rows: Sequence[Mapping[str, Any]]) -> tuple[list[Claim], list[dict[str, Any]], dict[str, Any]]:
    """Returns the claims, a table by object, and statistics.

    Args:
        rows: one a trial: `wearer`, `condition`, `object`, `success`, `reason`, `duration` (s).
    """
    table = [_line(code, [row for row in rows if row["object"] == code]) for code in YCB]
    table = [line for line in table if line["ikns of"] or line["ring of"]]
    paper = {"ikns paper": "{}/{}".format(*GRASPS["ikns"])}
    paper |= {"s paper": f"{SECONDS['ikns'][0]:.2f}", "ring s paper": f"{SECONDS['ring'][0]:.2f}"}
    table.append(_line("all", rows) | paper)
    done = {c: {(r["wearer"], r["object"]): r["duration"] for r in _of(rows, c) if r["success"]} for c in _CONDITIONS}
    both = sorted(done["ikns"].keys() & done["ring"].keys())
    statistics: dict[str, Any] = {c: counted(_of(rows, c)) for c in _CONDITIONS}
    claims = [_success(_of(rows, "ikns"))] if _of(rows, "ikns") else []
    if both:
        slow, fast = ([done[c][pair] for pair in both] for c in _CONDITIONS)
        test = sign_test(slow, fast)
        increase = median(a - b for a, b in zip(slow, fast, strict=True))
        statistics["sign test"] = {
            "pairs": len(both), "ring faster": test.more, "ring slower": test.less, "p": test.p, "median": increase,
            "by wearer": by_wearer(both, done),
        }  # fmt: skip
        claims.append(_faster(test, increase))
    return claims, table, statistics


def counted(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Successes, reasons of failure, and the times of those that succeeded."""
    good = [row for row in rows if row["success"]]
    times = summary([row["duration"] for row in good]) if good else None
    reasons = sorted({str(row["reason"]) for row in rows if not row["success"]})
    low, high = proportion(len(good), len(rows)) if rows else (0.0, 1.0)
    return {
        "successes": len(good),
        "of": len(rows),
        "low": low,
        "high": high,
        "mean s": times and times.mean,
        "deviation s": times and times.deviation,
        "median s": median(row["duration"] for row in good) if good else None,
        "failures": ", ".join(f"{reason} {sum(r['reason'] == reason for r in rows)}" for reason in reasons),
        "failed objects": "".join(sorted(str(r["object"]) for r in rows if not r["success"])),
    }


def by_wearer(both: Sequence[tuple[str, str]], done: Mapping[str, Mapping[tuple[str, str], float]]) -> dict[str, Any]:
    """The sign test of the wearers' median differences: pairs of one wearer aren't independent."""
    own: dict[str, list[float]] = {}
    for pair in both:
        own.setdefault(pair[0], []).append(done["ikns"][pair] - done["ring"][pair])
    medians = [median(values) for values in own.values()]
    test = sign_test(medians, [0.0] * len(medians))
    return {"wearers": len(medians), "ring faster": test.more, "ring slower": test.less, "p": test.p}


def _of(rows: Sequence[Mapping[str, Any]], condition: str) -> list[Mapping[str, Any]]:
    return [row for row in rows if row["condition"] == condition]


def _line(label: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    line: dict[str, Any] = {"object": f"{label} {YCB[label].name}" if label in YCB else label}
    for condition in _CONDITIONS:
        found = counted(_of(rows, condition))
        line |= {
            f"{condition} success": found["successes"], f"{condition} of": found["of"],
            f"{condition} s": found["mean s"], f"{condition} sd": found["deviation s"],
            f"{condition} failures": found["failures"],
        }  # fmt: skip
    return line


def _success(rows: Sequence[Mapping[str, Any]]) -> Claim:
    """Holds if the published share lies within the exact interval of ours, or ours is above it."""
    k, n = sum(bool(row["success"]) for row in rows), len(rows)
    good, of = GRASPS["ikns"]
    low, high = proportion(k, n)
    words = f"with IKNS no fewer succeed than in the paper; ours: {k} of {n}, exact 95 % {low:.3f} to {high:.3f}"
    return Claim(
        id="success-rate", text=words, paper=f"{good} of {of}", measured=100.0 * k / n, unit="%",
        holds=high >= good / of,
    )  # fmt: skip


def _faster(test: SignTest, increase: float) -> Claim:
    ikns, ring = SECONDS["ikns"], SECONDS["ring"]
    words = f"the ring is faster (exact sign test, {test.more} of {test.more + test.less} pairs, p = {test.p:.2g})"
    return Claim(
        id="ring-faster", text=words, measured=increase, unit="s, median increase with IKNS",
        paper=f"{MEDIAN_INCREASE} s, p < 0.01; means {ikns[0]} and {ring[0]} s",
        holds=test.more > test.less and test.p < _LEVEL,
    )  # fmt: skip
