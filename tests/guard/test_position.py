"""Whatever a controller asks for, the position guard keeps the limits; what is within them is followed."""

from math import inf, nan, pi

import numpy as np
import pytest
from helpers.guard import guard_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Command, Kind, Limits, Stop
from srl.runtime.guard import GUARDS

DT, V, A, LOW, HIGH = 0.01, 4.0, 40.0, -1.0, 1.5
jerks = st.sampled_from([None, 400.0, 4000.0])
value = st.one_of(
    st.floats(LOW - 0.5, HIGH + 0.5),
    st.sampled_from([nan, inf, -inf, LOW, HIGH, 1e300, HIGH - 1e-9, LOW + 1e-3]),
)
speed = st.one_of(st.none(), st.floats(-8, 8), st.sampled_from([nan, inf, 1e200]))
# What is asked for, at what speed, for how many cycles, of how many periods.
piece = st.tuples(value, speed, st.integers(1, 40), st.integers(1, 5))
ramp = st.tuples(st.just("ramp"), st.floats(-6, 6), st.integers(1, 40), st.integers(1, 5))


def position_guard(jerk=None, rest=None, joints=1, dt=DT):
    limits = {"lower": LOW, "upper": HIGH, "velocity": V, "acceleration": A, "jerk": jerk}
    return guard_of(Kind.POSITION, joints, dt, rest, **limits)


def demands(pieces):
    wanted = 0.0
    for what, how, cycles, periods in pieces:
        for _ in range(cycles):
            if what == "ramp":
                wanted += how * DT * periods
                yield np.array([wanted]), None, DT * periods
            else:
                wanted = what if np.isfinite(what) and abs(what) < 10 else wanted
                yield np.array([what]), None if how is None else np.array([how]), DT * periods


class Watch:
    """Asserts after each cycle that the new command is one a joint within its limits can have."""

    def __init__(self, guard, jerk):
        self.guard, self.jerk = guard, jerk
        self.p, self.v = guard.applied[0], guard.velocity[0]
        self.mean = self.v

    def check(self, dt):
        p, v = self.guard.applied[0], self.guard.velocity[0]
        assert np.isfinite([p, v]).all()
        assert LOW - 1e-9 <= p <= HIGH + 1e-9
        assert abs(v) <= V * (1 + 1e-9)
        assert abs(v - self.v) <= A * dt * (1 + 1e-6)
        assert abs(p - self.p) <= V * dt * (1 + 1e-9)
        # The device sees positions only: they must be those of the velocities.
        assert abs(p - self.p - dt * (v + self.v) / 2) <= A * dt * dt / 4 * (1 + 1e-6)
        self.p, self.v = p, v


@given(st.lists(st.one_of(piece, ramp), min_size=1, max_size=12), jerks, st.floats(LOW, HIGH))
@settings(max_examples=150)
def test_limits_hold_for_any_demand_and_any_stop_ends_at_rest(pieces, jerk, start):
    guard = position_guard(jerk)
    guard.reset(np.array([start]))
    assert guard.applied[0] == start
    watch = Watch(guard, jerk)
    for wanted, how, dt in demands(pieces):
        guard.step(wanted, how, dt)
        watch.check(dt)
        assert guard.rejected == (not np.isfinite(wanted).all() or (how is not None and not np.isfinite(how).all()))
    longest = V / A + (2 * A / jerk if jerk else 0)
    for _ in range(int(np.ceil(longest / DT)) + 1):
        guard.stop(Stop.HOLD, DT)
        watch.check(DT)
    assert guard.at_rest
    held = guard.applied.copy()
    guard.stop(Stop.HOLD, DT)
    assert guard.applied == held


@given(st.lists(st.one_of(piece, ramp), min_size=1, max_size=6))
@settings(max_examples=40)
def test_jerk_holds_too(pieces):
    jerk = 400.0
    guard = position_guard(jerk)
    guard.reset(np.zeros(1))
    before = 0.0
    for wanted, how, dt in demands(pieces):
        guard.step(wanted, how, dt)
        a = guard._states[0][2]
        assert abs(a) <= A * (1 + 1e-6)
        assert abs(a - before) <= jerk * dt * (1 + 1e-6)
        before = a


@given(st.floats(LOW, HIGH), st.floats(LOW, HIGH), jerks)
@settings(max_examples=60)
def test_a_reachable_target_is_reached_and_kept(start, target, jerk):
    guard = position_guard(jerk)
    guard.reset(np.array([start]))
    for _ in range(300):
        guard.step(np.array([target]), None, DT)
    assert guard.applied[0] == pytest.approx(target, abs=1e-6)
    assert guard.velocity[0] == pytest.approx(0, abs=1e-6)
    assert not guard.limited


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize(("jerk", "error"), [(None, 1e-12), (1000.0, 2e-4)])
@pytest.mark.parametrize(("frequency", "amplitude"), [(0.5, 0.5), (1.0, 0.5), (2.0, 0.2), (2.0, 0.24)])
def test_motion_within_limits_is_followed_without_lag(reported, jerk, error, frequency, amplitude):
    guard = position_guard(jerk)
    guard.reset(np.zeros(1))
    w = 2 * pi * frequency
    errors = []
    for t in DT * np.arange(1, 400):
        rate = np.array([amplitude * w * np.cos(w * t)]) if reported else None
        guard.step(np.array([amplitude * np.sin(w * t)]), rate, DT)
        errors.append(abs(guard.applied[0] - amplitude * np.sin(w * t)))
    assert max(errors[200:]) <= error  # a lag of one cycle would be amplitude w dt, 0.016 to 0.03
    assert guard.fallbacks == 0


def test_without_a_jerk_limit_a_step_takes_the_shortest_time():
    guard = position_guard()
    guard.reset(np.zeros(1))
    distance, cycles = 1.0, 0
    while abs(guard.applied[0] - distance) > 1e-9 and cycles < 200:
        guard.step(np.array([distance]), None, DT)
        cycles += 1
    assert cycles * DT == pytest.approx(distance / V + V / A, abs=2.5 * DT)


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize("jerk", [None, 4000.0])
@pytest.mark.parametrize("ahead", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("brakes", [0.05, 0.1, 0.3, 0.9])
def test_behind_a_target_that_brakes_it_is_never_faster_than_its_limit(reported, jerk, ahead, brakes):
    """At the end of a cycle the target is slower than in the middle of it, where the joint is at its limit."""
    guard = guard_of(Kind.POSITION, velocity=V, acceleration=A, jerk=jerk)
    guard.reset(np.zeros(1))
    target, rate = ahead, 0.0
    for k in range(80):
        rate = min(rate + 0.9 * A * DT, V) if k < 30 else max(rate - brakes * A * DT, 0.0)
        target += rate * DT
        before = guard.applied[0]
        guard.step(np.array([target]), np.array([rate]) if reported else None, DT)
        assert abs(guard.applied[0] - before) <= V * DT * (1 + 1e-9), k


def test_nan_brakes_and_the_next_good_command_is_followed_without_a_jump():
    guard = position_guard()
    guard.reset(np.zeros(1))
    for k in range(50):
        guard.step(np.array([0.02 * k]), None, DT)
    for _ in range(10):
        guard.step(np.array([nan]), None, DT)
    assert guard.rejected
    assert guard.rejections == 10
    assert guard.velocity[0] == 0
    held = guard.applied[0]
    guard.step(np.array([held + 0.5]), None, DT)
    assert not guard.rejected
    assert 0 < guard.applied[0] - held <= A * DT * DT / 2 * (1 + 1e-9)


def test_one_joints_nan_brakes_all():
    guard = position_guard(joints=2)
    guard.reset(np.zeros(2))
    guard.step(np.array([0.5, nan]), None, DT)
    assert (guard.applied == 0).all()


def test_a_pause_is_not_made_up_for():
    guard = position_guard()
    guard.reset(np.zeros(1))
    for k in range(30):
        guard.step(np.array([0.03 * k]), None, DT)
    before = guard.applied[0]
    guard.step(np.array([HIGH]), None, 3.0)
    assert guard.applied[0] - before <= V * 5 * DT


def test_a_clock_that_stands_still_moves_nothing():
    guard = position_guard()
    guard.reset(np.zeros(1))
    for _ in range(10):
        guard.step(np.array([1.0]), None, 0.0)
        guard.stop(Stop.HOLD, 0.0)
    assert guard.applied[0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("jerk", [None, 1000.0])
def test_retract_goes_slowly_to_rest(jerk):
    guard = position_guard(jerk, rest=np.array([-0.5]))
    guard.reset(np.array([1.0]))
    for _ in range(20):
        guard.step(np.array([1.4]), None, DT)
    watch, fastest = Watch(guard, jerk), 0.0
    for k in range(300):
        guard.stop(Stop.RETRACT, DT)
        watch.check(DT)
        if k > 40:
            fastest = max(fastest, abs(guard.velocity[0]))
    assert guard.at_rest
    assert guard.applied[0] == pytest.approx(-0.5, abs=1e-9)
    assert 0 < fastest <= V / 4 * (1 + 1e-9)


@pytest.mark.parametrize("jerk", [None, 1000.0])
@pytest.mark.parametrize(("limit", "side"), [(HIGH, 1.0), (LOW, -1.0)])
def test_started_beyond_a_limit_it_starts_there_and_only_comes_back(jerk, limit, side):
    guard = position_guard(jerk)
    guard.reset(np.array([limit + 0.2 * side]))
    assert guard.applied[0] == limit + 0.2 * side
    last = guard.applied[0]
    for _ in range(200):
        guard.step(np.array([limit + side]), None, DT)
        assert side * guard.applied[0] <= side * last + 1e-9
        last = guard.applied[0]
    assert last == pytest.approx(limit)


@pytest.mark.parametrize("jumps", [(0.0, 0.9, -0.3, 0.2, -0.8), (0.0, 0.006, -0.01, 0.015, 0.002)])
@pytest.mark.parametrize("jerk", [None, 1000.0])
@pytest.mark.parametrize("reported", [True, False])
def test_the_other_way_round_it_moves_the_other_way_round(jerk, reported, jumps):
    """A wave that jumps each 0.3 s, farther than the joint may go or by little."""
    limits = {"lower": -1.0, "upper": 1.0, "velocity": V, "acceleration": A, "jerk": jerk}
    one, other = guard_of(Kind.POSITION, **limits), guard_of(Kind.POSITION, **limits)
    one.reset(np.array([0.1]))
    other.reset(np.array([-0.1]))
    for k in range(300):
        wanted = np.array([0.4 * np.sin(0.07 * k) + jumps[k // 30 % 5]])
        rate = np.array([0.4 * 7.0 * np.cos(0.07 * k)]) if reported else None
        one.step(wanted, rate, DT)
        other.step(-wanted, None if rate is None else -rate, DT)
        assert other.applied[0] == pytest.approx(-one.applied[0], abs=1e-6), k
        assert other.velocity[0] == pytest.approx(-one.velocity[0], abs=1e-4), k


@given(st.lists(piece, min_size=1, max_size=5), jerks)
@settings(max_examples=20)
def test_the_same_demand_gives_the_same_bytes(pieces, jerk):
    def run():
        guard = position_guard(jerk)
        guard.reset(np.zeros(1))
        out = []
        for wanted, how, dt in demands(pieces):
            guard.step(wanted, how, dt)
            out.append(guard.applied.tobytes())
        return out

    assert run() == run()


def test_a_joint_does_not_feel_its_neighbours():
    alone, pair = position_guard(1000.0), position_guard(1000.0, joints=2)
    alone.reset(np.zeros(1))
    pair.reset(np.zeros(2))
    random = np.random.default_rng(3)
    for _ in range(100):
        a, b = random.uniform(LOW, HIGH, 2)
        alone.step(np.array([a]), None, DT)
        pair.step(np.array([a, b]), None, DT)
        assert alone.applied[0] == pair.applied[0]


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize("far", [1e10, 1e13, 1e14, 1e16, -1e99, 1e308])
@pytest.mark.parametrize("start", [0.0, 0.01, -0.5])
def test_a_target_beyond_all_reason_moves_no_joint_faster_than_its_limits(start, far, reported):
    """Without position limits. The last digit of 1e14 is 0.016: positions near it are as coarse."""
    guard = guard_of(Kind.POSITION, velocity=V, acceleration=A)
    guard.reset(np.array([start]))
    rate = np.zeros(1) if reported else None
    p, v = start, 0.0
    for k in range(90):
        guard.step(np.array([far if k % 30 < 15 else 0.2]), rate, DT)
        before, p, v = (p, v), guard.applied[0], guard.velocity[0]
        assert abs(v - before[1]) <= A * DT * (1 + 1e-6)
        assert abs(p - before[0] - DT * (v + before[1]) / 2) <= A * DT * DT / 4 * (1 + 1e-6) + 1e-10


@pytest.mark.parametrize("jerk", [None, 400.0])
def test_a_joint_that_may_not_move_stays_and_raises_nothing(jerk):
    """A device may give a velocity limit of zero."""
    one = np.ones(2)
    limits = Limits(velocity=V * np.array([0.0, 1.0]), acceleration=A * one, jerk=None if jerk is None else jerk * one)
    command = Command(name="c", shape=(2,), unit="rad", kind=Kind.POSITION)
    guard = GUARDS[command.kind]("guard.c", command, limits, DT, rest=-0.1 * one)
    guard.reset(np.zeros(2))
    for act in (lambda: guard.step(0.2 * one, None, DT), lambda: guard.stop(Stop.RETRACT, DT)):
        for _ in range(60):
            act()
            assert guard.applied[0] == guard.velocity[0] == 0
        assert abs(guard.applied[1]) > 0.09


def test_a_failing_generator_is_counted_and_brakes(monkeypatch):
    guard = position_guard()
    guard.reset(np.zeros(1))
    for _ in range(10):
        guard.step(np.array([1.0]), None, DT)
    monkeypatch.setattr(guard, "_planned", lambda *_: None)
    v = guard.velocity[0]
    guard.step(np.array([1.0]), None, DT)
    assert guard.fallback
    assert guard.fallbacks == 1
    assert guard.velocity[0] == pytest.approx(v - A * DT)


def test_it_fills_the_bound_row_in_place():
    row = np.full(6, 9.0)
    guard = position_guard(joints=2)
    guard.bind(row[2:4])
    guard.reset(np.array([0.1, 0.2]))
    assert row.tolist() == [9, 9, 0.1, 0.2, 9, 9]


def test_no_start_from_nan_and_no_command_before_a_start():
    guard = position_guard()
    with pytest.raises(RuntimeError):
        guard.step(np.zeros(1), None, DT)
    with pytest.raises(DeviceError, match="not finite"):
        guard.reset(np.array([nan]))
