"""The last line before the wire: whatever is asked for, a robot that checks every packet finds nothing wrong."""

import random
from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.panda.limiter import MotionLimiter, TorqueLimiter, approach
from srl.drivers.panda.limits import DT, FR3, PANDA, RobotLimits
from srl.runtime.contracts.signals import Kind
from srl.runtime.models import robots

HOME = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
ROBOTS = pytest.mark.parametrize("limits", [PANDA, FR3], ids=["panda", "fr3"])
# (target as a share of the limit, how many packets it lasts)
PLANS = st.lists(st.tuples(st.floats(-1.5, 1.5), st.integers(1, 400)), min_size=1, max_size=6)


class Robot:
    """Counts every packet as the robot does: changes from the last one, limits at the desired position."""

    def __init__(self, limits: RobotLimits, real: type) -> None:
        self.limits, self.real = limits, real
        self.q, self.dq, self.ddq = np.array(HOME), np.zeros(7), np.zeros(7)

    def state(self):
        return [self.real(x).tolist() for x in (self.q, self.dq, self.ddq)]

    def take(self, q, dq):
        L = self.limits
        ddq = (dq - self.dq) / DT
        jerk = (ddq - self.ddq) / DT
        assert (np.abs(ddq) <= np.array(L.acceleration) * 1.0001).all()
        assert (np.abs(jerk) <= np.array(L.jerk) * 1.0001).all()
        for i in range(7):
            most, least = L.fastest(i, L.upper[i] - q[i]), -L.fastest(i, q[i] - L.lower[i])
            assert least - 1e-9 <= dq[i] <= most + 1e-9, (i, q[i], dq[i])
        self.q, self.dq, self.ddq = q, dq, ddq

    def lose(self):
        """A packet was lost: the robot goes on with the acceleration it had."""
        self.dq = self.dq + self.ddq * DT
        self.q = self.q + self.dq * DT


@pytest.mark.slow
@ROBOTS
@pytest.mark.parametrize("real", [np.float64, np.float32])
@settings(max_examples=10, deadline=None)
@given(plan=PLANS, flip=st.lists(st.sampled_from([-1.0, 1.0]), min_size=7, max_size=7))
def test_any_velocity_becomes_a_motion_the_robot_accepts(limits, real, plan, flip):
    robot, limiter = Robot(limits, real), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    for share, packets in plan:
        wanted = (share * np.array(flip) * limits.velocity).tolist()
        for _ in range(packets):
            limiter.take(*robot.state())
            dq = np.array(limiter.velocity(wanted))
            robot.take(robot.q + dq * DT, dq)
    for _ in range(1500):
        limiter.take(*robot.state())
        dq = np.array(limiter.velocity([0.0] * 7))
        robot.take(robot.q + dq * DT, dq)
    assert limiter.at_rest


@ROBOTS
@pytest.mark.parametrize("sign", [-1, 1])
def test_full_speed_into_the_end_of_every_joint_stops_within_the_limits(limits, sign):
    robot, limiter = Robot(limits, np.float32), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    for _ in range(4000):
        limiter.take(*robot.state())
        dq = np.array(limiter.velocity([sign * 10.0] * 7))
        robot.take(robot.q + dq * DT, dq)
    ends = np.array(limits.upper if sign > 0 else limits.lower)
    assert (np.array(limits.lower) <= robot.q).all()
    assert (robot.q <= np.array(limits.upper)).all()
    assert np.abs(robot.q - ends).max() < 0.05  # as near as an FR3's limit of the velocity lets it


@ROBOTS
def test_a_step_is_followed_fast_and_without_overshoot(limits):
    limiter = MotionLimiter(limits)
    limiter.start(list(HOME))
    wanted = [0.5 * v for v in limits.velocity]
    wanted[3] *= -1
    seen = [list(limiter.velocity(wanted)) for _ in range(400)]
    for i in range(7):
        peak = max(abs(dq[i]) for dq in seen)
        assert peak <= abs(wanted[i]) + 1e-12
        needed = abs(wanted[i]) / limits.acceleration[i]
        there = next(k for k, dq in enumerate(seen) if abs(dq[i] - wanted[i]) < 1e-9)
        assert there * DT < 1.1 * needed + 0.015


def test_a_lost_packet_is_carried_on_from_where_the_robot_took_it():
    robot, limiter = Robot(PANDA, np.float64), MotionLimiter(PANDA)
    limiter.start(robot.q.tolist())
    for k in range(600):
        limiter.take(*robot.state())
        dq = np.array(limiter.velocity([1.0 if k < 300 else -1.0] * 7))
        if k % 7 == 3:
            robot.lose()
        else:
            robot.take(robot.q + dq * DT, dq)


@pytest.mark.sampled
@ROBOTS
@pytest.mark.parametrize("real", [np.float64, np.float32])
@pytest.mark.parametrize("position", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_many_lost_packets_make_no_oscillation(limits, real, position, seed):
    rng = random.Random(seed)
    robot, limiter = Robot(limits, real), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    wanted = np.array(HOME)
    plan = [(0.1 * rng.uniform(-1.5, 1.5), rng.randrange(50)) for _ in range(5)] + [(0.0, 1000)]
    for share, packets in plan:
        for _ in range(packets):
            gap = rng.choice([1, 1, 1, 2, 3, 8, 16])
            for _ in range(gap - 1):
                robot.lose()
            limiter.take(*robot.state(), ticks=gap)
            velocity = share * np.array(limits.velocity)
            if position:
                wanted = wanted + velocity * DT * gap
                q = np.array(limiter.position(wanted.tolist()))
                robot.take(q, (q - robot.q) / DT)
            else:
                dq = np.array(limiter.velocity(velocity.tolist()))
                robot.take(robot.q + dq * DT, dq)
    assert np.abs(robot.dq).max() < 5e-3
    assert np.abs(robot.ddq).max() < 1.0
    assert not position or np.abs(robot.q - wanted).max() < 1e-3


@pytest.mark.sampled
@ROBOTS
@pytest.mark.parametrize("gap", [1, 2, 3, 6, 12, 19])
@settings(max_examples=25, deadline=None)
@given(since=st.integers(1, 250), sign=st.sampled_from([-1.5, 1.5]), more=st.lists(st.integers(20, 120), max_size=2))
def test_losses_on_the_way_to_full_speed_are_no_reason_to_stop(limits, gap, since, sign, more):
    robot, limiter = Robot(limits, np.float64), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    wanted = (sign * np.array(limits.velocity)).tolist()
    missing = 0
    for packets in (since, *more, 60):
        for packet in range(packets):
            limiter.take(*robot.state(), ticks=1 if packet else missing + 1)
            dq = np.array(limiter.velocity(wanted))
            robot.take(robot.q + dq * DT, dq)
        missing = gap
        for _ in range(gap):
            robot.lose()


@ROBOTS
def test_a_smooth_position_is_followed_closely(limits):
    robot, limiter = Robot(limits, np.float32), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    errors = []
    for k in range(3000):
        t = k * DT
        wanted = np.array(HOME) + 0.2 * (1 - np.cos(2 * np.pi * 0.5 * t))
        limiter.take(*robot.state())
        q = np.array(limiter.position(wanted.tolist()))
        robot.take(q, (q - robot.q) / DT)
        errors.append(np.abs(q - wanted).max())
    assert max(errors) < 1e-3


@ROBOTS
def test_a_position_that_jumps_is_approached_within_the_limits(limits):
    robot, limiter = Robot(limits, np.float32), MotionLimiter(limits)
    limiter.start(robot.q.tolist())
    wanted = np.array(HOME) + 0.3
    for _ in range(3000):
        limiter.take(*robot.state())
        q = np.array(limiter.position(wanted.tolist()))
        robot.take(q, (q - robot.q) / DT)
    assert robot.q == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_an_angle_that_the_state_rounds_coarsely_is_no_reason_to_stop(seed):
    """Beyond 4 rad a float32 is off by 2.4e-7 rad, in the setpoint after a lost packet by 0.24 rad/s^2."""
    robot, limiter, rng, ticks = Robot(FR3, np.float32), MotionLimiter(FR3), random.Random(seed), 1
    robot.q[5] = 4.2
    limiter.start(robot.state()[0])
    wanted = robot.q.copy()
    for k in range(1500):
        wanted[5] = 4.2 + (0.2 if k // 200 % 2 else -0.2)
        if rng.random() < 0.3:
            robot.lose()
            ticks += 1
            continue
        limiter.take(*robot.state(), ticks)
        ticks, q = 1, np.array(limiter.position(wanted.tolist()))
        robot.take(q, (q - robot.q) / DT)


@given(error=st.floats(-5, 5), step=st.floats(1.0, 20.0))
def test_the_approach_ends_exactly_at_its_target(error, step):
    v, a = 0.0, 0.0
    for _ in range(5000):
        before = a
        a = min(max(approach(error - v, step), a - step), a + step)
        assert abs(a - before) <= step * (1 + 1e-9)
        v += a * DT
        assert abs(v) <= abs(error) + 1e-9
        if abs(error - v) < 1e-12 and abs(a) <= step:
            break
    assert v == pytest.approx(error, abs=1e-9)


@given(
    st.lists(st.lists(st.floats(-200, 200) | st.just(nan), min_size=7, max_size=7), min_size=1, max_size=20),
    st.lists(st.booleans(), min_size=20, max_size=20),
)
def test_torques_change_by_less_than_a_newton_metre_from_what_the_robot_took(wishes, lost):
    limiter, taken = TorqueLimiter(PANDA), [0.0] * 7
    for wanted, gone in zip(wishes, lost, strict=False):
        tau = limiter.step(wanted, taken)
        assert all(abs(new - old) < 1.0 for new, old in zip(tau, taken, strict=True))
        assert all(abs(new) <= most for new, most in zip(tau, PANDA.effort, strict=True))
        if not gone:
            taken = np.float32(tau).tolist()


def test_a_torque_command_under_way_is_no_reason_for_a_jump():
    limiter = TorqueLimiter(PANDA)
    first = limiter.step([5.0] * 7, [0.0] * 7)
    second = limiter.step([5.0] * 7, [0.0] * 7)  # the state hasn't seen the first: lost, or late
    assert all(abs(b - a) < 1.0 for a, b in zip(first, second, strict=True))
    third = limiter.step([-5.0] * 7, [0.0] * 7)
    assert all(abs(c - b) < 1.0 and abs(c) < 1.0 for b, c in zip(second, third, strict=True))
    assert limiter.step([5.0] * 7, [50.0] * 4 + [5.0] * 3)[0] > 49.0  # what the robot says counts in the end


def test_what_is_not_finite_keeps_the_torque_and_brakes_the_motion():
    assert TorqueLimiter(PANDA).step([nan] * 7, [3.0] * 7) == [3.0] * 7
    limiter = MotionLimiter(PANDA)
    limiter.start(list(HOME))
    for _ in range(100):
        limiter.velocity([0.2] * 7)
    for _ in range(100):
        limiter.velocity([nan] * 7)
    assert limiter.at_rest


@pytest.mark.parametrize(("limits", "arm"), [(PANDA, robots.PANDA), (FR3, robots.FR3)])
def test_the_tables_are_those_of_the_robots_description(limits, arm):
    for mine, theirs in (("lower", "q_lower"), ("upper", "q_upper"), ("velocity", "dq_max"),
                         ("acceleration", "ddq_max"), ("jerk", "dddq_max"), ("effort", "tau_max")):  # fmt: skip
        assert getattr(limits, mine) == pytest.approx(getattr(arm, theirs))


def test_the_guard_gets_limits_a_little_narrower_than_the_robots():
    torque = PANDA.of(Kind.TORQUE)
    assert torque.effort_rate is not None
    assert (torque.effort_rate < 1000).all()
    velocity = FR3.of(Kind.VELOCITY)
    assert velocity.effort_rate is None
    assert (velocity.acceleration < 10).all()
    assert (velocity.jerk < 5000).all()


@ROBOTS
@pytest.mark.parametrize("lag", [0.005, 0.06, 0.3])
def test_a_command_that_ran_ahead_is_caught_up_with_slowly(limits, lag):
    """The robot takes its time to start a motion; a guard that allows 0.3 rad/s doesn't expect 1 rad/s then."""
    motion = MotionLimiter(limits)
    motion.start(HOME)
    fastest = 0.0
    for k in range(4000):
        wanted = (lag + 0.3 * DT * min(k, 1000), *HOME[1:])
        motion.take(motion.q, motion.dq, motion.ddq)
        motion.position(wanted)
        fastest = max(fastest, motion.dq[0])
    assert fastest < 0.3 + 0.051 * limits.velocity[0]
    assert motion.q[0] == pytest.approx(wanted[0], abs=1e-4)
