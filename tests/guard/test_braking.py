"""The fastest stop, against ruckig's velocity interface, and its defining property."""

from math import inf, nextafter

import pytest
import ruckig
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.guard.braking import brake, stop_range, stoppable

A, J = 8.0, 60.0
velocities = st.floats(-5, 5)
accelerations = st.floats(-A, A)


def ruckig_stop(v, a, jerk):
    ask, plan = ruckig.InputParameter(1), ruckig.Trajectory(1)
    ask.control_interface = ruckig.ControlInterface.Velocity
    ask.current_position, ask.current_velocity, ask.current_acceleration = [0.3], [v], [a]
    ask.target_velocity = [0.0]
    ask.max_acceleration, ask.max_jerk = [A], [jerk]
    assert ruckig.Ruckig(1).calculate(ask, plan) == ruckig.Result.Working
    return plan


@given(velocities, accelerations, st.floats(0, 1))
def test_the_way_of_a_stop_is_ruckigs(v, a, share):
    plan = ruckig_stop(v, a, J)
    t = share * plan.duration
    (p,), (u,), (b,) = plan.at_time(t)
    assert brake((0.3, v, a), A, J, t) == pytest.approx((p, u, b), abs=1e-6)


@given(velocities, accelerations)
def test_range_of_a_stop_is_ruckigs(v, a):
    plan = ruckig_stop(v, a, J)
    way = [plan.at_time(plan.duration * k / 500) for k in range(501)]
    positions, speeds = [p for (p,), _, _ in way], [abs(u) for _, (u,), _ in way]
    low, high, speed = stop_range((0.3, v, a), A, J)
    assert low - 1e-9 <= min(positions)
    assert max(positions) <= high + 1e-9
    assert max(speeds) <= speed + 1e-9
    assert (low, high) == pytest.approx((min(positions), max(positions)), abs=1e-4)
    assert speed == pytest.approx(max(speeds), abs=2e-2)


@pytest.mark.parametrize("v", [0.02, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_turns_in_its_stop_comes_as_far_as_ruckigs(v, side):
    """It is slower than A^2/2J, and so turns before its acceleration is zero."""
    plan = ruckig_stop(-side * v, side * 0.9 * A, J)
    way = [plan.at_time(plan.duration * k / 5000)[0][0] for k in range(5001)]
    low, high, _ = stop_range((0.3, -side * v, side * 0.9 * A), A, J)
    assert (low, high) == pytest.approx((min(way), max(way)), abs=1e-7)
    assert min(way) < 0.3 < max(way)


@given(velocities, st.floats(0, 1))
def test_a_stop_without_jerk_limit_is_ruckigs(v, share):
    plan = ruckig_stop(v, 0.0, inf)
    t = share * plan.duration
    (p,), (u,), _ = plan.at_time(t)
    assert brake((0.3, v, 0.0), A, inf, t)[:2] == pytest.approx((p, u), abs=1e-9)


@given(velocities, accelerations, st.floats(1e-3, 1), st.sampled_from([J, inf]))
def test_braking_never_widens_the_range_of_its_stop(v, a, dt, jerk):
    state = (0.0, v, a if jerk < inf else 0.0)
    low, high, speed = stop_range(state, A, jerk)
    after = stop_range(brake(state, A, jerk, dt), A, jerk)
    assert after[0] >= low - 1e-9
    assert after[1] <= high + 1e-9
    assert after[2] <= speed + 1e-9


@given(st.floats(0, 10), st.sampled_from([J, inf]))
def test_stoppable_speeds_stop_in_time(distance, jerk):
    speed = stoppable(distance, A, jerk)
    assert stop_range((0.0, speed, 0.0), A, jerk)[1] <= distance + 1e-9


def test_stoppable_is_exact_where_it_says_so():
    assert stop_range((0.0, stoppable(2.0, A, inf), 0.0), A, inf)[1] == pytest.approx(2.0)
    fast = stoppable(2.0, A, J)
    assert fast > A * A / J
    assert stop_range((0.0, fast, 0.0), A, J)[1] == pytest.approx(2.0)
    assert stoppable(nextafter(0.0, -1.0), A, J) == 0.0
