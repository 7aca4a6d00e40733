"""Intervals of figures that a few trials of each wearer give: wearers are drawn again, not trials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.studies.toolkit.statistics import proportion

TIMES: Final = 4000  # samples of a bootstrap
_SEED: Final = 20221
_LEVEL: Final = 0.95


def most(k: int, n: int) -> float:
    """The exact upper bound, at 95 %, of the probability behind k of n (one-sided Clopper and Pearson)."""
    return proportion(k, n, 2.0 * _LEVEL - 1.0)[1]


def over_wearers(
    rows: Sequence[Mapping[str, Any]], columns: Sequence[str], figure: Callable[[Array], Array]
) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of a figure made of sums.

    Args:
        rows: of trials, with the column "wearer".
        columns: that are summed, k of them.
        figure: of sums (..., k), without the last axis.
    """
    own: dict[str, Array] = {}
    for row in rows:
        who = str(row["wearer"])
        own[who] = own.get(who, np.zeros(len(columns))) + [float(row[name]) for name in columns]
    if len(own) < 2:
        return float("nan"), float("nan")
    sums = np.array([own[who] for who in sorted(own)])
    chosen = np.random.default_rng(_SEED).integers(0, len(sums), (TIMES, len(sums)))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = figure(sums[chosen].sum(axis=1))
    low, high = np.nanpercentile(found, [50.0 * (1.0 - _LEVEL), 50.0 * (1.0 + _LEVEL)])
    return float(low), float(high)


def share(sums: Array) -> Array:
    """The first of two sums over the second."""
    found: Array = sums[..., 0] / sums[..., 1]
    return found
