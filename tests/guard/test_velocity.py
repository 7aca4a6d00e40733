"""Velocity commands on a simulated integrator, exact or one cycle late."""

from math import inf, nan

import numpy as np
import pytest
from helpers.guard import guard_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Kind, Stop

DT, V, A, LOW, HIGH = 0.01, 2.0, 10.0, -1.0, 1.0


class Axis:
    """A device that obeys a velocity exactly, `delay` cycles later."""

    def __init__(self, start=0.0, delay=0, rest=None):
        limits = {"lower": LOW, "upper": HIGH, "velocity": V, "acceleration": A}
        self.guard = guard_of(Kind.VELOCITY, dt=DT, rest=rest, **limits)
        self.q, self.applied = np.array([start]), np.zeros(1)
        self.guard.bind(self.applied, self.q)
        self.guard.reset(self.q)
        self.queue = [0.0] * delay

    def after(self, dt, action):
        before = self.applied[0]
        action()
        assert abs(self.applied[0] - before) <= A * dt * (1 + 1e-9)
        assert abs(self.applied[0]) <= V
        self.queue.append(self.applied[0])
        self.q += self.queue.pop(0) * dt

    def step(self, wanted, dt=DT):
        self.after(dt, lambda: self.guard.step(np.array([wanted]), None, dt))

    def stop(self, category):
        self.after(DT, lambda: self.guard.stop(category, DT))


wanted = st.one_of(st.floats(-5, 5), st.sampled_from([nan, inf, V, -V, 1e300]))
pieces = st.lists(st.tuples(wanted, st.integers(1, 80)), min_size=1, max_size=10)


@given(pieces, st.sampled_from([0, 1]), st.floats(LOW, HIGH))
@settings(max_examples=40)
def test_limits_hold_for_any_demand_and_a_stop_ends_at_rest(pieces, delay, start):
    axis = Axis(start, delay)
    assert axis.applied[0] == 0
    for what, cycles in pieces:
        for _ in range(cycles):
            axis.step(what)
            assert LOW - 1e-9 <= axis.q[0] <= HIGH + 1e-9
            assert axis.guard.rejected == (not np.isfinite(what))
    for _ in range(int(V / A / DT) + 1):
        axis.stop(Stop.HOLD)
        assert LOW - 1e-9 <= axis.q[0] <= HIGH + 1e-9
    assert axis.guard.at_rest
    assert axis.applied[0] == 0


def test_a_free_velocity_is_applied_as_asked():
    axis = Axis(-0.9)
    for _ in range(30):
        axis.step(0.7)
    assert axis.applied[0] == 0.7
    assert not axis.guard.limited


def test_beyond_a_limit_only_the_way_back_is_open():
    axis = Axis(HIGH + 0.1)
    axis.step(1.0)
    assert axis.applied[0] == 0
    assert axis.guard.limited
    for _ in range(5):
        axis.step(-1.0)
    assert axis.applied[0] < 0


def test_a_measurement_that_is_not_finite_brakes():
    axis = Axis()
    for _ in range(10):
        axis.step(1.0)
    axis.q[0] = nan
    before = axis.applied[0]
    axis.step(1.0)
    assert axis.guard.rejected
    assert axis.applied[0] == pytest.approx(before - A * DT)


@pytest.mark.parametrize("delay", [0, 1])
def test_retract_goes_slowly_to_rest(delay):
    axis = Axis(0.8, delay, rest=np.array([-0.5]))
    fastest = 0.0
    for _ in range(600):
        axis.stop(Stop.RETRACT)
        fastest = max(fastest, abs(axis.applied[0]))
    assert axis.guard.at_rest
    assert axis.q[0] == pytest.approx(-0.5, abs=1e-3)
    assert fastest <= V / 4


def test_an_old_position_is_not_retracted_from():
    guard = guard_of(
        Kind.VELOCITY, dt=0.01, rest=np.array([0.5]), lower=-1.0, upper=1.0, velocity=1.0, acceleration=2.0
    )
    applied, position = np.zeros(1), np.zeros(1)
    guard.bind(applied, position)
    guard.reset(position)
    for _ in range(50):
        guard.stop(Stop.RETRACT, 0.01)
    assert applied[0] > 0.1
    guard.unmeasured = True
    for _ in range(50):
        guard.stop(Stop.RETRACT, 0.01)
    assert applied[0] == 0.0
    assert guard.at_rest


@pytest.mark.parametrize(("category", "rest"), [(Stop.HOLD, None), (Stop.HOLD, np.array([0.5])), (Stop.RETRACT, None)])
def test_a_stop_without_a_place_to_go_to_brakes_as_fast_as_it_may(category, rest):
    axis = Axis(-0.5, rest=rest)
    for _ in range(20):
        axis.step(1.0)
    assert axis.applied[0] == 1.0
    for k in range(1, 11):
        axis.stop(category)
        assert axis.applied[0] == pytest.approx(1.0 - k * A * DT, abs=1e-12)
        assert not axis.guard.at_rest or k == 10
    axis.stop(category)
    assert axis.guard.at_rest


def test_without_a_clearance_each_joint_brakes_by_itself():
    guard = guard_of(Kind.VELOCITY, 2, DT, velocity=V, acceleration=A)
    guard.bind(np.zeros(2))
    guard.reset(np.zeros(2))
    for _ in range(30):
        guard.step(np.array([1.0, -0.5]), None, DT)
    for k in range(1, 13):
        guard.stop(Stop.HOLD, DT)
        assert guard.applied == pytest.approx([max(1.0 - k * A * DT, 0.0), min(-0.5 + k * A * DT, 0.0)], abs=1e-12)
