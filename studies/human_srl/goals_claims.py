"""The claims `goals-in-6-s`, `goals-in-18-s` and `goals-beside-still`: how often and how soon the arm gets there.

All shares are over that of an arm without a clearance, beside the same wearers. What could be reached at all is beside
them: the share of the goals at which the arm could rest in at least one look of ten a second, and of the looks.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.studies.human_srl.intervals import over_wearers
from srl.studies.result import Claim

Rows = Sequence[Mapping[str, Any]]
PACE_STILL: Final = 0.02  # of the pace: the first reach has hardly started when the motion ends
LONG, STILL = "18 s for a goal", "still wearer"
SECONDS_LONG: Final = 36.0
MOTIONS: Final = 100  # of each of the two
ARMS: Final[dict[str, tuple[dict[str, Any], float]]] = {
    LONG: ({"timeout": 18.0}, SECONDS_LONG),
    STILL: ({"pace": PACE_STILL}, 12.0),
}
LEAST: Final = {"goals-in-6-s": 0.6, "goals-in-18-s": 0.95, "goals-beside-still": 0.9}


def claims(within_6: Rows, long: Rows, still: Rows, free: Rows) -> list[Claim]:
    """Judges them by rows of the trial, of each condition; `free`: without a clearance."""
    return [
        _claim("goals-in-6-s", "beside a wearer who never gives way, 6 s for a goal", within_6, free),
        _claim("goals-in-18-s", "beside a wearer who never gives way, 18 s for a goal", long, free),
        _claim("goals-beside-still", "beside a wearer who stands still, 6 s for a goal", still, free),
    ]


def _claim(name: str, words: str, rows: Rows, free: Rows) -> Claim:
    tried, reached = (sum(int(row[key]) for row in rows) for key in ("tried", "reached"))
    base = _share(free)
    if not tried or not base:
        return Claim(id=name, text=f"{words}: no motion has its trial", paper="", measured=None, unit="", holds=False)
    low, high = (each / base for each in over_wearers(rows, ("reached", "tried"), _ratio))
    found = reached / tried / base
    return Claim(
        id=name,
        text=f"{words}: the arm reaches at least {LEAST[name]:g} of the share of goals that an arm without a clearance "
        f"does ({base:.3f}); {reached} of {tried} in {len(rows)} motions, 95 % interval over wearers {low:.2f} to "
        f"{high:.2f}; {comfort(rows)}; measured: the shares' ratio, its interval reported beside",
        paper="", measured=found, unit="", holds=found >= LEAST[name],
    )  # fmt: skip


def comfort(rows: Rows) -> str:
    """Times, the oracle and what a user feels, in words."""
    times = [t for row in rows for t in json.loads(str(row["times"])) if t is not None]
    looks = [x for row in rows for x in json.loads(str(row["open"]))]
    stands = [float(row["stands"]) for row in rows]
    jerk = [float(row["jerk"]) for row in rows]
    some = float(np.mean([x > 0.0 for x in looks])) if looks else float("nan")
    open_ = float(np.mean(looks)) if looks else float("nan")
    median = f"{np.median(times):.1f} s (median)" if times else "none"
    return (
        f"time to a goal {median}; the arm could rest at {100 * some:.0f} % of these goals in some look, in "
        f"{100 * open_:.0f} % of the looks; longest stand-still of a motion {np.median(stands):.1f} s (median), "
        f"{max(stands, default=0.0):.1f} s (longest); jerk of the tip {np.median(jerk):.0f} m/s3 rms (median)"
    )


def _share(rows: Rows) -> float:
    tried = sum(int(row["tried"]) for row in rows)
    return sum(int(row["reached"]) for row in rows) / tried if tried else 0.0


def _ratio(sums: Array) -> Array:
    found: Array = sums[..., 0] / sums[..., 1]
    return found
