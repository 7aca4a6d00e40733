"""The fastest motion to rest where the jerk is unbounded, against ruckig's and against what decides that it is one."""

from __future__ import annotations

import pytest
import ruckig
from hypothesis import assume, given
from hypothesis import strategies as st

from srl.runtime.guard.approach import approach

position = st.floats(-3, 3)
velocity = st.floats(-6, 6)
bound = st.floats(0.05, 4)
acceleration = st.floats(0.5, 60)
times = st.floats(1e-4, 2)


def planned(x: float, v: float, slowest: float, fastest: float, A: float, dt: float) -> tuple[float, float, float]:
    """The same by ruckig, and how long the motion takes."""
    ask, plan = ruckig.InputParameter(1), ruckig.Trajectory(1)
    ask.current_position, ask.current_velocity, ask.target_position = [x], [v], [0.0]
    ask.min_velocity, ask.max_velocity, ask.max_acceleration = [slowest], [fastest], [A]
    assert ruckig.Ruckig(1).calculate(ask, plan) == ruckig.Result.Working
    (p,), (pd,), _ = plan.at_time(dt)
    return p, pd, plan.duration


@given(position, velocity, bound, bound, acceleration, times)
def test_it_is_ruckigs(x: float, v: float, below: float, above: float, A: float, dt: float) -> None:
    try:
        p, pd, whole = planned(x, v, -below, above, A, dt)
    except ruckig.RuckigError:
        assume(False)
    if dt >= whole:
        p = pd = 0.0
    found = approach(x, v, -below, above, A, dt)
    assert found == (pytest.approx(p, abs=1e-8), pytest.approx(pd, abs=1e-7))


@given(position, velocity, bound, bound, acceleration, st.floats(1e-4, 0.05))
def test_step_by_step_it_is_the_same_motion_within_the_bounds(
    x: float, v: float, below: float, above: float, A: float, dt: float
) -> None:
    at, last = (x, v), v
    for k in range(1, 40):
        at = approach(*at, -below, above, A, dt)
        whole = approach(x, v, -below, above, A, k * dt)
        assert at == (pytest.approx(whole[0], abs=1e-9), pytest.approx(whole[1], abs=1e-8))
        assert abs(at[1] - last) <= A * dt * (1 + 1e-9) + 1e-12
        assert min(-below, v) - 1e-12 <= at[1] <= max(above, v) + 1e-12
        last = at[1]


@given(position, velocity, bound, bound, acceleration, times)
def test_its_mirror_image_is_the_same(x: float, v: float, below: float, above: float, A: float, dt: float) -> None:
    p, pd = approach(x, v, -below, above, A, dt)
    assert approach(-x, -v, -above, below, A, dt) == (-p, -pd)


@pytest.mark.parametrize("x", [0.0, -0.0, 0.3, -0.3])
@pytest.mark.parametrize("top", [0.0, 5e-324])
def test_with_no_velocity_allowed_it_stays_where_it_is(x: float, top: float) -> None:
    assert approach(x, 0.0, -top, top, 40.0, 0.01) == (x, pytest.approx(0.0))


@given(bound, acceleration)
def test_at_rest_it_stays(top: float, A: float) -> None:
    assert approach(0.0, 0.0, -top, top, A, 0.01) == (0.0, 0.0)
