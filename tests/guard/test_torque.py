"""Torque commands on a simulated inertia."""

from math import inf, nan

import numpy as np
import pytest
from helpers.guard import guard_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Kind, Stop

DT, E, RATE, V, LOW, HIGH = 0.001, 10.0, 2000.0, 2.0, -1.0, 1.0
SOFT = 0.04  # rad: the barrier is a spring


class Joint:
    """An inertia, kg m^2, under the applied torque less a constant load that gravity compensation carries."""

    def __init__(self, inertia=0.5, load=0.0, acceleration=None):
        limits = {"lower": LOW, "upper": HIGH, "velocity": V, "effort": E, "effort_rate": RATE, "inertia": inertia}
        limits["acceleration"] = acceleration
        self.guard = guard_of(Kind.TORQUE, dt=DT, **limits)
        self.inertia, self.load = inertia, load
        self.q, self.qd, self.tau, self.g = np.zeros(1), np.zeros(1), np.zeros(1), np.array([load])
        self.guard.bind(self.tau, self.q, self.qd, gravity=self.g)
        self.guard.reset(self.q)

    def after(self, action):
        before = self.tau[0]
        action()
        assert abs(self.tau[0]) <= E
        assert abs(self.tau[0] - before) <= RATE * DT * (1 + 1e-9)
        self.qd += (self.tau - self.load) / self.inertia * DT
        self.q += self.qd * DT

    def step(self, wanted):
        self.after(lambda: self.guard.step(np.array([wanted]), None, DT))

    def stop(self, category):
        self.after(lambda: self.guard.stop(category, DT))


wanted = st.one_of(st.floats(-30, 30), st.sampled_from([nan, inf, E, -E, 1e300]))


pieces = st.lists(st.tuples(wanted, st.integers(1, 300)), min_size=1, max_size=8)


@given(pieces, st.sampled_from([0.1, 0.5, 1.0, 4.0]))
@settings(max_examples=40)
def test_limits_hold_for_any_demand_on_a_joint_that_brakes_as_declared(pieces, inertia):
    joint = Joint(inertia, acceleration=0.6 * E / inertia)
    for what, cycles in pieces:
        for _ in range(cycles):
            joint.step(what)
            assert joint.guard.rejected == (not np.isfinite(what))
            assert LOW - SOFT <= joint.q[0] <= HIGH + SOFT
            assert abs(joint.qd[0]) <= 1.2 * V


@given(st.floats(1e-3, 1.0), st.floats(-0.9 * V, 3), st.floats(-50, 50), st.booleans())
def test_beyond_a_limit_the_torque_points_inwards(beyond, outwards, asked, high):
    joint = Joint()
    joint.q[0] = HIGH + beyond if high else LOW - beyond
    joint.qd[0] = outwards if high else -outwards
    for _ in range(20):
        joint.guard.step(np.array([asked]), None, DT)
    assert joint.tau[0] < 0 if high else joint.tau[0] > 0


def test_within_limits_a_torque_passes_unchanged():
    joint = Joint(load=4.0)
    assert joint.tau[0] == 4.0
    for _ in range(20):
        joint.step(4.5)
    assert joint.tau[0] == 4.5
    assert not joint.guard.limited


def test_gravity_compensation_passes_at_a_limit():
    joint = Joint(load=4.0)
    joint.q[0] = HIGH
    joint.guard.step(np.array([4.0]), None, DT)
    assert joint.tau[0] == 4.0


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_a_moving_joint_is_brought_to_rest_and_carries_its_load(category):
    joint = Joint(load=3.0)
    joint.qd[0] = 1.0
    for _ in range(3000):
        joint.stop(category)
    assert joint.guard.at_rest
    assert joint.qd[0] == pytest.approx(0, abs=0.04)
    assert joint.tau[0] == pytest.approx(3.0, abs=0.3)


@given(st.floats(0.1, V), st.floats(1.0, 10.0), st.sampled_from([Stop.DAMP, Stop.HOLD]))
@settings(max_examples=15)
def test_a_stop_isn_t_over_while_a_joint_moves_by_itself(speed, heavier, category):
    joint = Joint()
    joint.inertia *= heavier  # more moves with it than the least
    joint.qd[0] = speed
    while not joint.guard.at_rest:
        moved = abs(joint.qd[0])
        joint.stop(category)
    assert moved <= 0.021 * V


@pytest.mark.parametrize("effort", [2.0, 10.0])
@pytest.mark.parametrize("rate", [50, 100, 1000])
@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_nor_at_a_low_rate_or_of_a_heavy_joint_that_damps_slowly(category, rate, effort):
    """Twenty times the least inertia moves. At 50 Hz it takes 3 s to slow by two thirds."""
    dt, inertia = 1 / rate, 0.05
    guard = guard_of(Kind.TORQUE, dt=dt, velocity=3.0, effort=effort, effort_rate=300.0, inertia=inertia)
    tau, q, qd = np.zeros(1), np.zeros(1), np.full(1, 1.5)
    guard.bind(tau, q, qd)
    guard.reset(q)
    while not guard.at_rest:
        moved = abs(qd[0])
        guard.stop(category, dt)
        qd += tau / (20 * inertia) * dt
        q += qd * dt
    assert moved <= 0.021 * 3.0


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_a_stop_is_over_though_a_hand_moves_the_joint_on(category):
    joint = Joint()
    joint.qd[0] = 1.0
    cycles = 0
    while not joint.guard.at_rest:
        joint.stop(category)
        joint.qd += 2.0 / joint.inertia * DT  # 2 N m against 5 N m s/rad
        cycles += 1
        assert cycles < 1000
    assert abs(joint.qd[0]) > 0.02 * V
    if category is Stop.DAMP:
        assert joint.tau[0] == pytest.approx(-5.0 * joint.qd[0], rel=0.1)  # it gives way as before


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_a_joint_that_a_hand_lets_go_moves_by_itself(category):
    """Pushed for a moment, it coasts; the other one is pushed on all the time."""
    limits = {"lower": -9.0, "upper": 9.0, "velocity": V, "effort": E, "effort_rate": RATE, "inertia": 2.0}
    guard = guard_of(Kind.TORQUE, 2, DT, **limits)
    q, qd, tau = np.zeros(2), np.array([0.1, 1.9]), np.zeros(2)
    guard.bind(tau, q, qd)
    guard.reset(q)
    for cycle in range(3000):
        guard.stop(Stop.DAMP if cycle < 500 else category, DT)
        if cycle > 600 and guard.at_rest:
            break
        qd += (tau + np.array([16.0 * (cycle < 150), 4.0])) / 2.0 * DT
        q += qd * DT
        if cycle > 600 and category is Stop.HOLD:
            assert tau[0] == pytest.approx(-5.0 * qd[0], rel=0.05) or abs(qd[0]) < 0.05  # no spring yet
    assert abs(qd[0]) <= 0.021 * V


def test_hold_doesnt_creep_under_a_steady_force():
    joint = Joint()
    for _ in range(2000):
        joint.stop(Stop.HOLD)
        joint.qd += 2.0 / joint.inertia * DT
    there = joint.q[0]
    for _ in range(2000):
        joint.stop(Stop.HOLD)
        joint.qd += 2.0 / joint.inertia * DT
    assert joint.q[0] == pytest.approx(there, abs=1e-3)
    assert there < 0.2  # rad; at 0.4 rad/s it would be 1.6 by now


def test_hold_springs_back_to_where_it_came_to_rest():
    joint = Joint()
    for _ in range(200):
        joint.stop(Stop.HOLD)
    for _ in range(100):  # a push of 3 N m
        joint.stop(Stop.HOLD)
        joint.qd += 3.0 / joint.inertia * DT
    pushed = joint.q[0]
    for _ in range(3000):
        joint.stop(Stop.HOLD)
    assert pushed > 0.01
    assert joint.q[0] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("between", [Stop.DAMP, Stop.LIMP])
def test_held_again_it_holds_where_it_has_gone_meanwhile(between):
    joint = Joint()
    for _ in range(200):
        joint.stop(Stop.HOLD)
    for _ in range(500):  # a hand leads it on
        joint.stop(between)
        joint.qd += 3.0 / joint.inertia * DT
    was_active = joint.q[0]
    for _ in range(3000):
        joint.stop(Stop.HOLD)
    assert was_active > 0.1
    assert joint.q[0] > 0.95 * was_active  # not back to where it was held before


@pytest.mark.parametrize("before", [Stop.DAMP, Stop.HOLD])
def test_limp_forgets_that_a_hand_led_the_joint(before):
    joint = Joint()
    for _ in range(600):
        joint.stop(before)
        joint.qd += 2.0 / joint.inertia * DT
    assert joint.guard.at_rest
    for _ in range(300):
        joint.stop(Stop.LIMP)
    joint.q[:], joint.qd[:] = 0.0, 1.5
    joint.stop(Stop.DAMP)
    assert not joint.guard.at_rest  # it moves by itself
    joint.q[:] = 0.2
    joint.stop(Stop.HOLD)
    assert joint.tau[0] > -5.0 * 1.5  # no spring yet: the rate lets this much through in two cycles


def test_limp_ramps_to_gravity_compensation_only():
    joint = Joint(load=3.0)
    for _ in range(10):
        joint.step(8.0)
    joint.stop(Stop.LIMP)
    assert joint.tau[0] == pytest.approx(8.0 - RATE * DT)
    for _ in range(10):
        joint.stop(Stop.LIMP)
    assert joint.guard.at_rest
    assert joint.tau[0] == 3.0


def test_blind_it_ramps_to_gravity_compensation():
    joint = Joint(load=3.0)
    for _ in range(10):
        joint.step(8.0)
    joint.qd[0] = nan
    for _ in range(10):
        joint.guard.step(np.array([8.0]), None, DT)
    assert joint.guard.rejected
    assert joint.tau[0] == 3.0


@pytest.mark.parametrize("inertia", [0.05, 0.5])
def test_full_effort_settles_at_the_velocity_limit(inertia):
    joint = Joint(inertia)
    fastest = 0.0
    while joint.q[0] < 0.7:
        joint.step(E)
        fastest = max(fastest, joint.qd[0])
    assert 0.6 * V < fastest <= V * (1 + 1e-3)


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD, Stop.BRAKE])
def test_old_measurements_damp_nothing(category):
    """A velocity that stands still in the row would be opposed for ever, and so drive the joint."""
    joint = Joint(load=3.0)
    joint.qd[:] = 1.0
    joint.guard.unmeasured = True
    for _ in range(100):
        joint.guard.stop(category, DT)
    assert joint.tau[0] == pytest.approx(3.0)
    assert joint.guard.at_rest


def test_seen_again_it_holds_where_it_is_then():
    joint = Joint()
    for _ in range(50):
        joint.stop(Stop.HOLD)
    joint.guard.unmeasured = True
    joint.stop(Stop.HOLD)
    joint.guard.unmeasured = False
    joint.q[:] = 0.5  # it sagged meanwhile
    for _ in range(500):
        joint.stop(Stop.HOLD)
    assert joint.q[0] == pytest.approx(0.5, abs=1e-3)


def swing(inertia, reported, category, late=2, seconds=3.0):
    """Greatest speed in the last half second of a stop from 1 rad/s, the torque `late` periods behind."""
    limits = {"velocity": 2.0, "effort": 80.0, "effort_rate": 1000.0, "inertia": reported}
    guard = guard_of(Kind.TORQUE, dt=DT, **limits)
    tau, q, qd = np.zeros(1), np.zeros(1), np.ones(1)
    guard.bind(tau, q, qd)
    guard.reset(q)
    waiting, speeds = [0.0] * late, []
    for _ in range(round(seconds / DT)):
        guard.stop(category, DT)
        waiting.append(tau[0])
        qd += waiting.pop(0) / inertia * DT
        q += qd * DT
        speeds.append(abs(qd[0]))
    return max(speeds[-500:])


@pytest.mark.parametrize("inertia", [0.004, 0.012, 0.05, 0.4])
@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_a_light_joint_comes_to_rest_behind_a_delay_if_its_inertia_is_told(inertia, category):
    assert swing(inertia, inertia, category) < 0.01
    assert swing(2 * inertia, inertia, category) < 0.01  # more moves with it in other postures
    assert swing(10 * inertia, inertia, category, seconds=8.0) < 0.05


def test_told_ten_times_too_much_it_would_ring():
    assert swing(0.05, 0.5, Stop.DAMP) > 5.0


def test_a_start_lets_go_of_what_a_stop_presses_against_by_the_rate():
    """A hand has pulled a held arm 0.2 rad away: a hold presses with 5 N m, and a new start may not drop them."""
    joint = Joint(load=4.0)
    for _ in range(50):
        joint.stop(Stop.HOLD)
    joint.q[0] += 0.2
    for _ in range(10):
        joint.guard.stop(Stop.HOLD, DT)
    pressed = joint.tau[0]
    assert abs(pressed - joint.load) > 2.0
    joint.guard.reset(joint.q, was_active=True)
    assert joint.tau[0] == pressed
    for _ in range(50):
        before = joint.tau[0]
        joint.guard.step(np.array([joint.load]), None, DT)
        assert abs(joint.tau[0] - before) <= RATE * DT * (1 + 1e-9)
    assert joint.tau[0] == joint.load


def test_a_start_of_what_nobody_led_begins_at_gravity():
    joint = Joint(load=4.0)
    joint.tau[0] = 9.0
    joint.guard.reset(joint.q)
    assert joint.tau[0] == joint.load


@pytest.mark.parametrize("load", [4.0, -4.0])
@pytest.mark.parametrize("asked", [E, -E])
def test_beside_gravity_compensation_no_torque_exceeds_the_effort(load, asked):
    joint = Joint(load=load)
    for _ in range(20):
        joint.guard.step(np.array([asked]), None, DT)
    assert joint.tau[0] == np.clip(load + np.clip(asked - load, -E, E), -E, E)
    for _ in range(20):
        joint.guard.step(np.array([100.0 * asked]), None, DT)
    assert joint.tau[0] == np.clip(load + asked, -E, E)
