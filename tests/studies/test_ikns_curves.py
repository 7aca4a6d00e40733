"""The curves of the tracking experiment: what the paper says of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.studies.ikns.curves import KINDS, SECONDS, curve

T = np.arange(0.0, SECONDS + 1e-9, 0.01)
RATE = {name: np.gradient(curve(name, T), T) for name in KINDS}


@pytest.mark.parametrize("name", KINDS)
def test_a_curve_stays_within_the_range_and_begins_and_parts_flat(name: str) -> None:
    y = curve(name, T)
    assert 0.0 < y.min() < y.max() < 1.0
    np.testing.assert_allclose(curve(name, [-5.0, -0.1]), y[0])
    flat = np.abs(RATE[name]) < 1e-3
    assert flat[:30].all()
    assert np.count_nonzero(np.diff(flat.astype(int)) == 1) >= 3


@pytest.mark.parametrize("name", KINDS)
def test_rate_and_acceleration_do_not_jump(name: str) -> None:
    fine = np.arange(0.0, SECONDS, 1e-3)
    rate = np.gradient(curve(name, fine), fine)
    step, coarse = np.abs(np.diff(rate)).max(), np.abs(np.diff(rate[::2])).max()
    assert step < 0.6 * coarse  # halved with the step, as of a continuous function


def test_t1_is_the_slowest_and_t2_the_fastest() -> None:
    rms = {name: float(np.sqrt((rate**2).mean())) for name, rate in RATE.items()}
    assert rms["T1"] < rms["T3"] < rms["T2"]


def test_t2_goes_from_90_to_about_30_in_less_than_3_s() -> None:
    y = curve("T2", T)
    falls = [y[i] >= 0.89 and y[i : i + 300].min() <= 0.31 for i in range(len(y))]
    assert any(falls)


@given(st.sampled_from(sorted(KINDS)), st.floats(-10, 40), st.floats(-10, 40))
def test_a_value_depends_on_its_own_time_alone(name: str, a: float, b: float) -> None:
    both = curve(name, [a, b])
    assert both[0] == curve(name, [a])[0]
    assert both[1] == curve(name, [b])[0]
