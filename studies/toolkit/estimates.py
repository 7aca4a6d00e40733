"""Means over subjects with their intervals, in the words of a claim or the columns of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from srl.studies.toolkit.statistics import interval


@dataclass(frozen=True)
class Estimate:
    """The mean of n subjects and its 95 % interval, which is NaN for fewer than two."""

    n: int
    mean: float
    low: float
    high: float

    def columns(self, name: str) -> dict[str, float]:
        """For a table: name, name_low, name_high."""
        return {name: self.mean, f"{name}_low": self.low, f"{name}_high": self.high}

    def __str__(self) -> str:
        return f"{self.mean:.3g} ({self.low:.3g} to {self.high:.3g})"


def estimate(values: Sequence[float], least: float = -math.inf, most: float = math.inf) -> Estimate:
    """Estimates the mean of the values that are there, one a subject; NaN counts as not there.

    Student's interval is cut to `least` and `most`, where the mean can't be beyond them.
    """
    found = [float(v) for v in values if not math.isnan(v)]
    low, high = interval(found) if len(found) > 1 else (math.nan, math.nan)
    mean = float(np.mean(found)) if found else math.nan
    return Estimate(len(found), mean, float(np.clip(low, least, most)), float(np.clip(high, least, most)))
