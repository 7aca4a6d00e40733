"""The fastest way to rest without a jerk limit, against ruckig."""

from __future__ import annotations

from math import inf

import pytest
import ruckig
from hypothesis import assume, given
from hypothesis import strategies as st

from runtime.guard.approach import approach


@given(
    st.one_of(st.floats(-2, 2), st.sampled_from([0.0, 1e-9, -1e-6])),
    st.one_of(st.floats(-5, 5), st.sampled_from([0.0, 4.0, -4.0])),
    st.floats(1.0, 50.0),
    st.floats(-6.0, -0.05),
    st.floats(0.05, 6.0),
    st.floats(1e-4, 3.0),
)
def test_it_is_what_ruckig_plans(
    x: float, v: float, A: float, slowest: float, fastest: float, dt: float
) -> None:
    """Velocities outside the bounds among them; the acceleration is compared between its jumps."""
    ask, plan = ruckig.InputParameter(1), ruckig.Trajectory(1)
    ask.current_position, ask.current_velocity, ask.current_acceleration = [x], [v], [0.0]
    ask.target_position, ask.max_jerk, ask.max_acceleration = [0.0], [inf], [A]
    ask.max_velocity, ask.min_velocity = [fastest], [slowest]
    assume(ruckig.Ruckig(1).calculate(ask, plan) == ruckig.Result.Working)
    (p,), (u,), _ = plan.at_time(dt)
    if dt >= plan.duration:
        p = u = 0.0
    q, w, a = approach(x, v, A, slowest, fastest, dt)
    assert (q, w) == pytest.approx((p, u), abs=1e-7)
    later, w_later, _ = approach(x, v, A, slowest, fastest, dt + 1e-7)
    assert abs(later - q - 1e-7 * w) < 1e-6
    assert abs(w_later - w) <= A * 1e-7 * 1.01 + 1e-9
    assert abs(a) in (0.0, A)
