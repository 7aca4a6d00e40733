"""Summaries, intervals, and tests of paired samples: the same subjects under two conditions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from srl.runtime.contracts.signals import Array
from srl.studies.toolkit.errors import StudyError, numbers, pairs

LEVELS: Final = (0.001, 0.01, 0.05)  # the paper's levels of significance
WHISKER: Final = 1.5  # interquartile ranges, Tukey's


@dataclass(frozen=True)
class Summary:
    """Mean and sample standard deviation (n - 1); the deviation of a single value is nan."""

    n: int
    mean: float
    deviation: float


@dataclass(frozen=True)
class Box:
    """The figures of a boxplot.

    Attributes:
        lower, median, upper: quartiles, straight lines between the order statistics (numpy's default).
        low, high: the whiskers' ends: the outermost values within 1.5 interquartile ranges of the quartiles.
        outliers: the values beyond the whiskers.
    """

    lower: float
    median: float
    upper: float
    low: float
    high: float
    outliers: tuple[float, ...]


@dataclass(frozen=True)
class SignTest:
    """The exact two-sided sign test of paired samples; ties are left out.

    Attributes:
        more, less, ties: pairs in which the first is larger, smaller, equal.
        p: probability of this split, or a more uneven one, if both signs were equally likely; 1 if all are ties.
    """

    more: int
    less: int
    ties: int
    p: float


@dataclass(frozen=True)
class PairedT:
    """The two-sided paired t-test on the differences first - second.

    Attributes:
        difference: their mean, in the values' unit.
        t, freedom: the statistic and its degrees of freedom.
        p: probability of a mean this large, or larger, if the true mean were 0.
    """

    difference: float
    t: float
    freedom: int
    p: float


@dataclass(frozen=True)
class ShapiroWilk:
    """The Shapiro-Wilk test: a small p is evidence against a normal distribution; a large p doesn't prove one."""

    w: float
    p: float


@dataclass(frozen=True)
class Equivalence:
    """Two one-sided paired t-tests (Schuirmann 1987) on the differences first - second.

    Attributes:
        difference: their mean, in the values' unit.
        low, high: its interval of level 1 - 2 alpha; equivalent if it lies within the margin.
        p: the larger of the two tests' p-values.
        equivalent: p is below alpha.
    """

    difference: float
    low: float
    high: float
    p: float
    equivalent: bool


def summary(values: ArrayLike, place: str = "summary") -> Summary:
    """Returns mean and standard deviation of (n,) values; raises StudyError if there are none or one isn't finite."""
    found = numbers(place, values)
    deviation = float(np.std(found, ddof=1)) if len(found) > 1 else math.nan
    return Summary(len(found), float(np.mean(found)), deviation)


def box(values: ArrayLike, place: str = "boxplot") -> Box:
    """Returns quartiles, whiskers and outliers of (n,) values; raises StudyError as `summary` does."""
    found = np.sort(numbers(place, values))
    lower, median, upper = (float(q) for q in np.quantile(found, (0.25, 0.5, 0.75)))
    reach = WHISKER * (upper - lower)
    inside = (found >= lower - reach) & (found <= upper + reach)
    # A quartile can lie between two values. If there is no value between it and its fence, the whisker has length 0.
    low = min(float(found[inside][0]), lower)
    high = max(float(found[inside][-1]), upper)
    return Box(lower, median, upper, low, high, tuple(float(v) for v in found[~inside]))


def holm(p: ArrayLike) -> list[float]:
    """Holm's step-down correction of several tests' probabilities, in their order (Holm 1979)."""
    values = numbers("p", p)
    corrected, largest = np.empty(len(values)), 0.0
    for rank, i in enumerate(np.argsort(values, kind="stable")):
        largest = max(largest, min(1.0, (len(values) - rank) * values[i]))
        corrected[i] = largest
    return [float(value) for value in corrected]


def sign_test(first: ArrayLike, second: ArrayLike, place: str = "sign test") -> SignTest:
    """Computes the exact sign test of (n,) and (n,) values, pair by pair. Of successes it is McNemar's exact test.

    Raises:
        StudyError: they are empty, not finite, or don't pair.
    """
    one, other = pairs(place, first, second)
    more, less = int(np.sum(one > other)), int(np.sum(one < other))
    return SignTest(more, less, len(one) - more - less, _binomial(more, more + less))


def paired_t(first: ArrayLike, second: ArrayLike, place: str = "paired t-test") -> PairedT:
    """Computes the paired t-test of (n,) and (n,) values, n >= 2.

    Raises:
        StudyError: as in `sign_test`, or all differences are the same.
    """
    one, other = pairs(place, first, second, 2)
    difference = one - other
    _varied(place, difference, float(np.max(np.abs([one, other]))), "Take the sign test")
    from scipy import stats

    found = stats.ttest_1samp(difference, 0.0)
    return PairedT(float(np.mean(difference)), float(found.statistic), len(difference) - 1, float(found.pvalue))


def tost(
    first: ArrayLike, second: ArrayLike, margin: float, alpha: float = 0.05, place: str = "equivalence test"
) -> Equivalence:
    """Tests whether the mean difference of (n,) and (n,) paired values lies within +-margin, n >= 2.

    Raises:
        StudyError: as in `paired_t`, or the margin isn't positive.
    """
    if not margin > 0 or not 0 < alpha < 0.5:
        raise StudyError(place, f"margin {margin:g} at level {alpha:g}", "Take a positive margin, and 0.05")
    one, other = pairs(place, first, second, 2)
    difference = one - other
    _varied(place, difference, float(np.max(np.abs([one, other]))), "Compare it with the margin yourself")
    from scipy import stats

    n, mean = len(difference), float(np.mean(difference))
    error = float(np.std(difference, ddof=1)) / math.sqrt(n)
    reach = float(stats.t.ppf(1 - alpha, n - 1)) * error
    p = float(stats.t.sf((margin - abs(mean)) / error, n - 1))
    return Equivalence(mean, mean - reach, mean + reach, p, p < alpha)


def interval(values: ArrayLike, level: float = 0.95, place: str = "interval") -> tuple[float, float]:
    """Returns Student's interval of the mean of (n,) values, n >= 2; raises StudyError as `summary` does."""
    found = numbers(place, values, 2)
    from scipy import stats

    reach = float(stats.t.ppf((1 + level) / 2, len(found) - 1)) * float(np.std(found, ddof=1)) / math.sqrt(len(found))
    return float(np.mean(found)) - reach, float(np.mean(found)) + reach


def proportion(
    k: int, n: int, level: float = 0.95, place: str = "proportion", method: Literal["exact", "wilson"] = "exact"
) -> tuple[float, float]:
    """Returns an interval of the probability behind k successes of n > 0.

    Args:
        method: exact (Clopper and Pearson 1934), or Wilson's (1927), which is shorter and right on the average.

    Raises:
        StudyError: there are no trials, or not as many.
    """
    if not 0 <= k <= n or n == 0:
        raise StudyError(place, f"{k} successes of {n}", "Give the successes, and the number of all trials")
    from scipy import stats

    found = stats.binomtest(k, n).proportion_ci(level, method=method)
    return float(found.low), float(found.high)


def rate(k: int, exposure: float, level: float = 0.95, place: str = "rate") -> tuple[float, float]:
    """Returns the exact interval (Garwood 1936) of the rate of a Poisson process with k events in a time > 0.

    Raises:
        StudyError: the count is negative, or there was no time.
    """
    if k < 0 or not (math.isfinite(exposure) and exposure > 0.0):
        raise StudyError(place, f"{k} events in {exposure:g}", "Give the events, and the time they took")
    from scipy import stats

    low = float(stats.chi2.ppf((1 - level) / 2, 2 * k)) / 2.0 if k else 0.0
    return low / exposure, float(stats.chi2.ppf((1 + level) / 2, 2 * k + 2)) / 2.0 / exposure


def shapiro_wilk(values: ArrayLike, place: str = "Shapiro-Wilk test") -> ShapiroWilk:
    """Computes the Shapiro-Wilk test of (n,) values, 3 <= n <= 5000. Before a paired t-test: of the differences.

    Raises:
        StudyError: too few, too many, not finite, or all the same.
    """
    found = numbers(place, values, 3)
    if len(found) > 5000:
        raise StudyError(place, f"{len(found)} values, expected at most 5000", "Test one value a subject, not a signal")
    _varied(place, found, float(np.max(np.abs(found))), "It says nothing about a constant")
    from scipy import stats

    w, p = stats.shapiro(found)
    return ShapiroWilk(float(w), float(p))


def level(p: float) -> float | None:
    """Returns the strictest of the levels 0.001, 0.01 and 0.05 that `p` is below; None if it is below none."""
    return next((alpha for alpha in LEVELS if p < alpha), None)


def stars(p: float) -> str:
    """Returns `***`, `**`, `*` for p below 0.001, 0.01, 0.05; else nothing."""
    alpha = level(p)
    return "" if alpha is None else "*" * (len(LEVELS) - LEVELS.index(alpha))


def words(p: float) -> str:
    """Returns a p-value as tables print it: two figures, or "p < 0.001"."""
    return "p < 0.001" if p < LEVELS[0] else f"p = {p:.2g}"


def _binomial(k: int, n: int) -> float:
    """Returns twice the smaller tail of a fair binomial, in whole numbers until the last division."""
    tail = sum(math.comb(n, i) for i in range(min(k, n - k) + 1))
    return min(2 * tail / 2**n, 1.0)


def _varied(place: str, values: Array, largest: float, remedy: str) -> None:
    # Differences of numbers read from text carry rounding: 0.3 - 0.2 isn't 0.2 - 0.1.
    if np.ptp(values) <= 1e-14 * largest:
        raise StudyError(place, f"all {len(values)} values are the same, {values[0]:g}", remedy)
