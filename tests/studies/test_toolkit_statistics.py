"""Tests of paired samples against scipy and by hand; the boxes against matplotlib's."""

from __future__ import annotations

import math
from statistics import fmean, stdev

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.cbook import boxplot_stats
from scipy import stats

from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.statistics import (
    box,
    interval,
    level,
    paired_t,
    proportion,
    rate,
    shapiro_wilk,
    sign_test,
    stars,
    summary,
    tost,
    words,
)

VALUES = st.lists(st.integers(-20, 20).map(float), min_size=1, max_size=40)
PAIRS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=200)


@given(PAIRS)
def test_the_sign_test_is_scipys_binomial_test_without_ties(pairs: list[tuple[int, int]]) -> None:
    first, second = zip(*pairs, strict=True)
    found = sign_test(first, second)
    assert found.more + found.less + found.ties == len(pairs)
    n = found.more + found.less
    assert found.p == pytest.approx(stats.binomtest(found.more, n).pvalue if n else 1.0, rel=1e-12)
    back = sign_test(second, first)
    assert (back.more, back.less, back.p) == (found.less, found.more, found.p)


def test_sign_tests_by_hand() -> None:
    assert sign_test(range(12), [-1] * 12).p == 2 / 4096
    assert sign_test([1] * 10 + [0] * 2, [0] * 10 + [1] * 2).p == 2 * (1 + 12 + 66) / 4096
    assert sign_test([5] * 4, [5] * 4).p == 1.0


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=2, max_size=30))
def test_the_paired_t_test_is_scipys(pairs: list[tuple[float, float]]) -> None:
    first, second = (np.array(side) for side in zip(*pairs, strict=True))
    difference = first - second
    if np.ptp(difference) <= 1e-6:
        return
    found, theirs = paired_t(first, second), stats.ttest_rel(first, second)
    by_hand = difference.mean() / (difference.std(ddof=1) / math.sqrt(len(difference)))
    assert found.t == pytest.approx(by_hand, rel=1e-9, abs=1e-12)
    assert (found.t, found.p) == pytest.approx((theirs.statistic, theirs.pvalue), rel=1e-6, abs=1e-12)
    assert found.freedom == len(pairs) - 1


@pytest.mark.parametrize(("k", "n"), [(0, 10), (88, 100), (50, 50), (3, 7)])
def test_the_exact_interval_of_a_proportion_cuts_tails_of_a_fortieth(k: int, n: int) -> None:
    low, high = proportion(k, n)
    assert low <= k / n <= high
    if k > 0:
        assert stats.binom.sf(k - 1, n, low) == pytest.approx(0.025, abs=1e-6)
    if k < n:
        assert stats.binom.cdf(k, n, high) == pytest.approx(0.025, abs=1e-6)


@pytest.mark.parametrize(("k", "n"), [(0, 0), (3, 2), (-1, 5)])
def test_successes_that_cannot_be_are_refused(k: int, n: int) -> None:
    with pytest.raises(StudyError, match=f"{k} successes of {n}"):
        proportion(k, n)


@given(st.integers(0, 400), st.floats(0.01, 1000.0))
def test_the_exact_interval_of_a_rate_cuts_tails_of_a_fortieth(k: int, exposure: float) -> None:
    low, high = rate(k, exposure)
    assert low <= k / exposure <= high
    assert stats.poisson.cdf(k, high * exposure) == pytest.approx(0.025, abs=1e-6)
    if k > 0:
        assert stats.poisson.sf(k - 1, low * exposure) == pytest.approx(0.025, abs=1e-6)


@pytest.mark.parametrize(("k", "exposure"), [(-1, 1.0), (0, 0.0), (3, math.nan), (3, math.inf)])
def test_a_rate_without_time_is_refused(k: int, exposure: float) -> None:
    with pytest.raises(StudyError, match=f"{k} events in"):
        rate(k, exposure)


def test_shapiro_wilk_tells_a_normal_sample_from_a_skewed_one() -> None:
    rng = np.random.default_rng(3)
    assert shapiro_wilk(rng.normal(size=50)).p > 0.05
    assert shapiro_wilk(rng.exponential(size=50)).p < 0.001
    # Shapiro and Wilk's own example of 1965: weights of eleven men, W = 0.79.
    assert shapiro_wilk([148, 154, 158, 160, 161, 162, 166, 170, 182, 195, 236]).w == pytest.approx(0.79, abs=0.005)


@given(VALUES)
def test_boxes_are_matplotlibs(values: list[float]) -> None:
    found, theirs = box(values), boxplot_stats(values)[0]
    ours = (found.lower, found.median, found.upper, found.low, found.high)
    assert ours == pytest.approx([theirs[key] for key in ("q1", "med", "q3", "whislo", "whishi")], abs=1e-12)
    assert sorted(found.outliers) == sorted(theirs["fliers"])


@given(VALUES)
def test_summaries_are_the_exact_ones(values: list[float]) -> None:
    found = summary(values)
    assert found.mean == pytest.approx(fmean(values), abs=1e-12)
    if len(values) == 1:
        assert math.isnan(found.deviation)
    else:
        assert found.deviation == pytest.approx(stdev(values), abs=1e-9)


def test_levels_are_strict() -> None:
    assert [level(p) for p in (0.0009, 0.001, 0.0099, 0.01, 0.049, 0.05)] == [0.001, 0.01, 0.01, 0.05, 0.05, None]
    assert [stars(p) for p in (0.0001, 0.005, 0.02, 0.5)] == ["***", "**", "*", ""]
    assert [words(p) for p in (0.0004, 0.0039, 0.2890625)] == ["p < 0.001", "p = 0.0039", "p = 0.29"]


@pytest.mark.parametrize("test", [sign_test, paired_t])
def test_wrong_pairs(test: object) -> None:
    assert callable(test)
    for first, second, says in (
        ([1, 2, 3], [1, 2], "3 values don't pair with 2"),
        ([], [], "got 0"),
        ([1, math.nan], [1, 2], "value 2 of 2 is nan"),
        ([[1, 2]], [1, 2], "one row of numbers"),
        (["a", "b"], [1, 2], "expected numbers"),
    ):
        with pytest.raises(StudyError, match=says):
            test(first, second)


def test_tests_that_have_no_answer_say_so() -> None:
    with pytest.raises(StudyError, match=r"all 3 values are the same.*sign test"):
        paired_t([0.1, 0.2, 0.3], [0.2, 0.3, 0.4])
    with pytest.raises(StudyError, match="all 4 values are the same"):
        shapiro_wilk([2, 2, 2, 2])
    with pytest.raises(StudyError, match="at least 3"):
        shapiro_wilk([1, 2])
    with pytest.raises(StudyError, match="at most 5000"):
        shapiro_wilk(np.arange(5001))


@given(
    st.lists(st.floats(-5, 5), min_size=3, max_size=30).filter(lambda v: np.ptp(v) > 0.01),
    st.floats(0.1, 5),
    st.sampled_from((0.01, 0.05, 0.1)),
)
def test_equivalence_is_two_one_sided_t_tests(difference: list[float], margin: float, alpha: float) -> None:
    found = tost(difference, np.zeros(len(difference)), margin, alpha)
    above = stats.ttest_1samp(difference, -margin, alternative="greater").pvalue
    below = stats.ttest_1samp(difference, margin, alternative="less").pvalue
    assert found.p == pytest.approx(max(above, below), rel=1e-9, abs=1e-12)
    assert found.equivalent == (found.p < alpha)
    if abs(found.p - alpha) > 1e-9:  # the same said by the interval
        assert found.equivalent == (-margin < found.low and found.high < margin)


def test_equivalence_refuses_a_margin_that_is_none() -> None:
    with pytest.raises(StudyError, match="positive margin"):
        tost([1, 2, 3], [1, 2, 4], 0.0)


def test_an_interval_of_a_mean_is_students() -> None:
    values = [1.0, 2.0, 4.0, 8.0]
    low, high = interval(values)
    expected = stats.t.interval(0.95, 3, np.mean(values), stats.sem(values))
    assert (low, high) == pytest.approx(expected)
