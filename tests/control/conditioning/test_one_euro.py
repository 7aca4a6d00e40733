"""The 1 euro filter: against numbers computed by hand, an independent implementation, and what must always hold."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.conditioning.one_euro import OneEuro, OneEuroConfig
from srl.testing import ControllerConformance, bound


def law(**options: Any) -> OneEuro:
    made = bound(OneEuro("filter", OneEuroConfig(**options)))
    made.applied = {}
    made.input["x"][:] = np.nan
    made.reset()
    return made


def filtered(made: OneEuro, samples: list[float], dts: list[float]) -> list[float]:
    found = []
    for sample, dt in zip(samples, dts, strict=True):
        made.input["x"][:] = sample
        made.update(dt)
        found.append(float(made.output["y"][0]))
    return found


class Published:
    """Algorithm 1 of the paper as it is printed there, with its names; the rate is that since the last sample."""

    def __init__(self, mincutoff: float, beta: float, dcutoff: float) -> None:
        self.mincutoff, self.beta, self.dcutoff = mincutoff, beta, dcutoff
        self.hatx: float | None = None
        self.hatdx: float | None = None

    def filter(self, x: float, rate: float) -> float:
        dx = 0.0 if self.hatx is None else (x - self.hatx) * rate
        self.hatdx = self.lowpass(self.hatdx, dx, self.alpha(rate, self.dcutoff))
        cutoff = self.mincutoff + self.beta * abs(self.hatdx)
        self.hatx = self.lowpass(self.hatx, x, self.alpha(rate, cutoff))
        return self.hatx

    @staticmethod
    def alpha(rate: float, cutoff: float) -> float:
        return 1.0 / (1.0 + (1.0 / (2.0 * pi * cutoff)) / (1.0 / rate))

    @staticmethod
    def lowpass(hat: float | None, x: float, alpha: float) -> float:
        return x if hat is None else alpha * x + (1.0 - alpha) * hat


class TestOneEuro(ControllerConformance):
    inputs, start = {"x": [0.3, -2.0]}, {"y": [0.1, 0.0]}

    def law(self) -> OneEuro:
        return bound(OneEuro("filter", OneEuroConfig(labels=("a", "b"), min_cutoff={"b": 0.5, "a": 2.0}, beta=0.1)))


def test_three_samples_by_hand() -> None:
    """With 2 pi f = 1 for both cutoffs, dt = 1 and beta = pi: samples 0, 1, 1.

    Second: dx = 1, v = 1/2; 2 pi f = 1 + 2 pi (pi/2) = 1 + pi^2; a = w/(w + 1); x = (1 + pi^2)/(2 + pi^2).
    Third: dx = 1 - x = 1/(2 + pi^2); v = 1/2 (1/2 + dx); w = 1 + 2 pi^2 v; x += (1 - x) w/(w + 1).
    """
    one = 1.0 / (2.0 * pi)
    made = law(min_cutoff=one, beta=pi, d_cutoff=one)
    second = (1.0 + pi**2) / (2.0 + pi**2)
    v = 0.5 * (0.5 + 1.0 / (2.0 + pi**2))
    w = 1.0 + 2.0 * pi**2 * v
    third = second + (1.0 - second) * w / (w + 1.0)
    assert filtered(made, [0.0, 1.0, 1.0], [1.0] * 3) == pytest.approx([0.0, second, third], rel=1e-14)
    assert (second, third) == pytest.approx((0.9157511939, 0.9891520085), abs=1e-9)


@given(
    samples=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40), dt=st.floats(1e-3, 1.0), jitter=st.floats(0, 1),
    min_cutoff=st.floats(0.01, 50), beta=st.floats(0, 10), d_cutoff=st.floats(0.01, 50),
)  # fmt: skip
def test_it_is_the_published_algorithm_at_any_rate(
    samples: list[float], dt: float, jitter: float, min_cutoff: float, beta: float, d_cutoff: float
) -> None:
    dts = [dt * (1.0 + jitter * (i % 3)) for i in range(len(samples))]
    published = Published(min_cutoff, beta, d_cutoff)
    expected = [published.filter(sample, 1.0 / each) for sample, each in zip(samples, dts, strict=True)]
    found = filtered(law(min_cutoff=min_cutoff, beta=beta, d_cutoff=d_cutoff), samples, dts)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_without_beta_it_is_a_low_pass_with_the_cutoff_it_says() -> None:
    """A sine at the cutoff comes through with 1/sqrt(2) of its amplitude."""
    dt, made = 1e-4, law(min_cutoff=5.0)
    samples = np.sin(2.0 * pi * 5.0 * dt * np.arange(20000))
    found = filtered(made, samples.tolist(), [dt] * len(samples))
    assert max(found[10000:]) == pytest.approx(2.0**-0.5, rel=0.01)


def test_beta_takes_the_lag_of_fast_motion_and_leaves_the_rest_smooth() -> None:
    ramp, still = [0.1 * i for i in range(200)], [0.01 * (-1) ** i for i in range(200)]
    lag, shake = {}, {}
    for beta in (0.0, 1.0):
        lag[beta] = ramp[-1] - filtered(law(beta=beta), ramp, [0.01] * 200)[-1]
        shake[beta] = np.ptp(filtered(law(beta=beta), still, [0.01] * 200)[100:])
    assert lag[1.0] < 0.2 * lag[0.0]
    assert max(shake.values()) < 0.1 * np.ptp(still)


@given(
    values=st.lists(st.floats(-10, 10) | st.sampled_from([np.nan, np.inf]), max_size=50),
    dt=st.sampled_from([0.0, 1e-9, 0.01, 0.1]), beta=st.floats(0, 5),
)  # fmt: skip
def test_it_stays_within_its_samples_and_holds_what_is_unknown(values: list[float], dt: float, beta: float) -> None:
    made, seen, last = law(beta=beta), list[float](), np.nan
    for value in values:
        (y,) = filtered(made, [value], [dt])
        if np.isfinite(value):
            seen.append(value)
        else:
            assert y == last or np.isnan(last)
        if seen:
            assert min(seen) - 1e-9 <= y <= max(seen) + 1e-9
        last = y


def test_a_sample_after_a_pause_counts_with_the_whole_pause() -> None:
    paused, whole = law(beta=0.3), law(beta=0.3)
    samples = [0.0, 1.0, np.nan, np.nan, np.nan, 2.0]
    expected = filtered(whole, [0.0, 1.0, 2.0], [0.01, 0.01, 0.04])
    assert filtered(paused, samples, [0.01] * 6)[-1] == pytest.approx(expected[-1])


def test_a_reset_forgets_and_begins_at_the_sample() -> None:
    made = law()
    filtered(made, [5.0] * 20, [0.01] * 20)
    made.reset()
    assert filtered(made, [1.0, 1.0], [0.01] * 2) == [1.0, 1.0]


def test_what_overflows_is_taken_for_unknown_and_leaves_nothing_behind() -> None:
    made = law(beta=1.0)
    found = filtered(made, [0.0, 1.7e308, -1.7e308, 1.7e308, 1.0, 1.0], [1e-3] * 6)
    assert np.isfinite(found).all()
    assert filtered(made, [1.0] * 5000, [0.01] * 5000)[-1] == pytest.approx(1.0, abs=0.1)


def test_each_element_has_its_own_cutoff() -> None:
    made = law(labels=("a", "b"), min_cutoff={"b": 1.0, "a": 10.0})
    made.input["x"][:] = 0.0
    made.update(0.01)
    made.input["x"][:] = 1.0
    made.update(0.01)
    expected = [0.01 / (0.01 + 1.0 / (2.0 * pi * f)) for f in (10.0, 1.0)]
    np.testing.assert_allclose(made.output["y"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"min_cutoff": 0.0}, "min_cutoff: it isn't above 0"), ({"d_cutoff": -1.0}, "d_cutoff"), ({"beta": -1.0}, "beta")],
)
def test_options_that_dont_fit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        OneEuroConfig(**options)
