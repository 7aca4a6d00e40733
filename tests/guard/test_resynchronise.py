"""The guard against a link that takes only some of its commands: no step beyond the limits from what was sent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Array, Command, Kind, Stop
from srl.runtime.guard import GUARDS, CommandGuard, GuardLimits

DT = 0.01
LIMITS: dict[Kind, dict[str, Any]] = {
    Kind.POSITION: {"lower": -2.0, "upper": 2.0, "velocity": 4.0, "acceleration": 40.0},
    Kind.VELOCITY: {"velocity": 1.0, "acceleration": 5.0},
    Kind.TORQUE: {"velocity": 2.0, "effort": 20.0, "effort_rate": 200.0, "inertia": 1.0},
}
RATE = {Kind.POSITION: 4.0, Kind.VELOCITY: 5.0, Kind.TORQUE: 200.0}  # of the command at most, a second


class Link:
    """A guard, and a device that takes what it is given in some cycles."""

    def __init__(
        self, kind: Kind, period: float = 0.02, resolution: float = 0.0, size: int = 1, dt: float = DT, **limits: Any
    ) -> None:
        command = Command(name="c", shape=(size,), unit="1", kind=kind, period=period, resolution=resolution)
        given_limits = GuardLimits(**(LIMITS[kind] | limits)).to_limits((size,), "guard.c")
        self.guard: CommandGuard = GUARDS[kind]("guard.c", command, given_limits, dt)
        self.applied, self.sent = np.zeros(size), np.full(size, np.nan)
        self.q, self.qd = np.zeros(size), np.zeros(size)
        self.guard.bind(self.applied, self.q, self.qd, self.sent)
        self.guard.reset(np.zeros(size))
        self.seen: list[bool] = []
        self.left = False

    def send(self, values: Array) -> None:
        self.sent[:], self.left = values, True

    def cycle(self, desired: float | Array, takes: bool = True, dt: float = DT, stop: bool = False) -> float:
        self.guard.resynchronise(self.left, dt)
        self.left = False
        self.seen.append(self.guard.resynchronised)
        if stop:
            self.guard.stop(Stop.HOLD, dt)
        else:
            self.guard.step(np.broadcast_to(desired, self.applied.shape), None, dt)
        if takes:
            self.send(self.applied)
        return float(self.sent[0])


cycles = st.lists(
    st.tuples(
        st.sampled_from([-3.0, -1.0, 0.0, 0.3, 1.0, 3.0, np.nan]),
        st.integers(1, 12),  # cycles with it
        st.sampled_from([True, True, False]),  # whether the link takes commands meanwhile
        st.sampled_from([1.0, 1.0, 1.0, 0.5, 2.0, 7.0, 60.0]),  # periods that the first cycle takes
        st.booleans(),  # a stop
    ),
    min_size=2,
    max_size=25,
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.INTENSITY])
@settings(max_examples=150, deadline=None)
@given(script=cycles)
def test_what_is_sent_never_steps_beyond_the_limits_from_what_was_sent_before(kind: Kind, script: Any) -> None:
    link = Link(kind)
    patience = 5 * DT  # the longer of the command's period and five of the loop's
    gap, before = 0.0, np.nan
    stopped = False  # since one was taken: a stop of a velocity or torque goes on towards rest, whatever leaves
    for desired, times, takes, periods, stop in script:
        for k in range(times):
            stopped |= stop and kind is not Kind.POSITION
            dt = DT * (periods if k == 0 else 1.0)
            gap += dt
            sent = link.cycle(desired, takes, dt, stop)
            if takes:
                if np.isfinite(before):
                    most = RATE[kind] * (gap if gap <= patience + 1e-9 else DT)
                    step = abs(sent) - abs(before) if stopped else abs(sent - before)
                    assert step <= most * (1 + 1e-9) + 1e-9, (sent, before, gap)
                gap, before, stopped = 0.0, sent, False
            elif link.applied[0] == before:
                gap = 0.0  # it holds where the device is: what follows begins there


def test_a_stall_is_followed_by_a_ramp_from_where_the_limb_is() -> None:
    """A servo board that took nothing for 0.9 s was then given one step of 1.12 rad."""
    link = Link(Kind.POSITION)
    t = 0.0

    def wave() -> float:
        return 0.8 * np.sin(2 * np.pi * 0.5 * t)

    for _ in range(150):
        t += DT
        link.cycle(wave())
    last = float(link.sent[0])
    for _ in range(90):
        t += DT
        link.cycle(wave(), takes=False)
    assert abs(wave() - last) > 1.0
    steps = []
    for _ in range(100):
        t += DT
        before = float(link.sent[0])
        steps.append(abs(link.cycle(wave()) - before))
    assert steps[0] <= 0.5 * 40.0 * DT**2 + 1e-9, "it begins at rest"
    assert max(np.abs(np.diff(steps))) <= 40.0 * DT**2 + 1e-9, "and speeds up within the acceleration limit"
    assert abs(float(link.sent[0]) - wave()) < 1e-6, "and meets the wave again"
    assert any(link.seen[200:240])
    assert not any(link.seen[-90:])


def test_the_law_reads_back_where_the_device_is_before_it_computes_the_next_command() -> None:
    link = Link(Kind.POSITION)
    for _ in range(20):
        link.cycle(1.0)
    for _ in range(20):
        link.cycle(1.0, takes=False)
    link.guard.resynchronise(link.left, DT)
    assert link.applied[0] == link.sent[0]


def test_a_slow_device_and_one_that_rounds_leave_the_guard_alone() -> None:
    """What was sent isn't fed back while the device keeps its period: it would slow every law down."""
    slow, free = Link(Kind.VELOCITY, period=0.2), Link(Kind.VELOCITY)
    for k in range(100):
        slow.cycle(0.7, takes=k % 15 == 14)
        free.cycle(0.7)
        assert slow.applied[0] == free.applied[0]
    assert not any(slow.seen)
    rounding = Link(Kind.POSITION, resolution=1e-3)
    for k in range(300):
        wanted = 0.2 * np.sin(0.02 * k)
        rounding.cycle(wanted, takes=False)
        rounding.send(np.round(rounding.applied, 3))
        assert k < 20 or abs(rounding.applied[0] - wanted) < 1e-9  # it starts with a jump of the velocity
    assert not any(rounding.seen)


@pytest.mark.parametrize(("kind", "resolution"), [(Kind.POSITION, 5e-3), (Kind.VELOCITY, 0.12), (Kind.TORQUE, 2.5)])
def test_a_coarse_device_that_stalls_is_followed_by_no_step_either(kind: Kind, resolution: float) -> None:
    """One period's step from what was sent is less than what is rounded: it doesn't show that a command was taken."""
    link = Link(kind, period=0.06, resolution=resolution)
    period = 0.5 * LIMITS[kind]["acceleration"] * DT**2 if kind is Kind.POSITION else RATE[kind] * DT
    assert period < resolution
    target = {Kind.POSITION: 1.5, Kind.VELOCITY: 0.9, Kind.TORQUE: 15.0}[kind]
    for _ in range(5):
        link.cycle(target)
    last = float(link.sent[0])
    apart = []
    for _ in range(200):
        link.cycle(target, takes=False)
        apart.append(abs(float(link.applied[0]) - last))
    faster = (2 * 40.0 * resolution) ** 0.5 * DT if kind is Kind.POSITION else 0.0  # while it is within the resolution
    assert max(apart[:6]) > resolution + period + faster, "for the command's period it goes on"
    assert max(apart[8:]) <= resolution + period + faster
    link.cycle(target)
    for _ in range(200):
        link.cycle(target)
    assert link.sent[0] == link.applied[0] == pytest.approx(target)
    assert not any(link.seen[-190:])


def test_a_device_that_sends_only_what_it_can_tell_apart_leaves_a_stall_again() -> None:
    """A servo board sends no pulse that rounds to the last one: the guard must get beyond that."""
    link = Link(Kind.POSITION, resolution=5e-3, acceleration=4.0)
    t = 0.0

    def cycle(takes: bool) -> None:
        nonlocal t
        t += DT
        link.cycle(0.3 * np.sin(2.0 * t), takes=False)
        if takes and not abs(link.applied[0] - link.sent[0]) <= 5e-3:
            link.send(link.applied)

    for takes, times in ((True, 100), (False, 100), (True, 200)):
        for _ in range(times):
            cycle(takes)
    assert any(link.seen[100:200])
    assert not any(link.seen[-150:])
    assert abs(link.applied[0] - 0.3 * np.sin(2.0 * t)) < 1e-6


def test_a_limiter_in_the_device_is_known_in_the_next_cycle() -> None:
    link = Link(Kind.TORQUE)
    torques = []
    for _ in range(30):
        link.cycle(10.0, takes=False)
        link.send(np.minimum(link.applied, 3.0))
        torques.append(float(link.applied[0]))
    assert max(torques) <= 3.0 + 200.0 * DT, "the guard's torque doesn't run away from the limited one"
    assert link.guard.resyncs > 10


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.INTENSITY])
def test_until_the_first_command_has_left_the_guard_waits_at_its_start(kind: Kind) -> None:
    link = Link(kind)
    link.sent[:] = 0.5  # of a run before; the limb has been moved since
    link.guard.reset(np.zeros(1))
    start = float(link.applied[0])
    for _ in range(50):
        link.cycle(1.0, takes=False)
    assert abs(link.applied[0] - start) <= RATE[kind] * DT
    link.guard.resynchronise(link.left, DT)
    assert link.applied[0] == start


def test_a_pause_of_the_loop_is_a_stall_too() -> None:
    link = Link(Kind.POSITION)
    for _ in range(30):
        link.cycle(2.0)
    before = float(link.sent[0])
    assert abs(link.cycle(2.0, dt=0.3) - before) <= 0.5 * 40.0 * DT**2 + 1e-9
    assert link.seen[-1]


def test_what_a_driver_reports_as_no_number_is_no_place_to_begin() -> None:
    link = Link(Kind.POSITION)
    for _ in range(30):
        link.cycle(1.0)
    last = float(link.sent[0])
    for _ in range(30):
        link.cycle(1.0, takes=False)
        link.send(np.full(1, np.nan))
    link.guard.resynchronise(link.left, DT)
    assert link.applied[0] == last


def test_what_was_sent_must_have_the_commands_shape() -> None:
    from srl.runtime.contracts.errors import WiringError

    link = Link(Kind.VELOCITY)
    with pytest.raises(WiringError, match="sent has shape"):
        link.guard.bind(np.zeros(1), None, None, np.zeros(2))


@pytest.mark.parametrize("rate", [60.0, 100.0, 333.0, 1000 / 3, 1000.0])
@pytest.mark.parametrize("every", [1, 3, 5, 6, 10, 11, 12, 20])
def test_a_device_that_keeps_exactly_its_period_is_never_taken_for_a_stalled_one(rate: float, every: int) -> None:
    """50 commands/s declared as 0.02 s from a 1 kHz loop: a law of 0.1 s never arrived."""
    dt = 1 / rate
    link = Link(Kind.VELOCITY, period=every * dt, dt=dt)
    for k in range(10 * every + 100):
        jitter = 1.0 + 0.05 * (-1) ** (k // every)  # some spans between two commands are longer
        link.cycle(link.applied + (0.3 - link.applied) * dt / 0.1, takes=k % every == 0, dt=dt * jitter)
    assert not any(link.seen)


def test_an_element_that_the_device_limits_leaves_the_others_alone() -> None:
    """Each cycle began at rest for all: another joint braked with 139 rad/s^2 of 40, and lagged by 0.15 rad."""
    link = Link(Kind.POSITION, resolution=1e-4, size=2)
    sent, wanted = [], []
    for k in range(400):
        wanted.append(0.5 * np.sin(0.04 * k))
        link.cycle(wanted[-1], takes=False)
        link.send(np.minimum(link.applied, [1.0, 0.3]))
        sent.append(link.sent.copy())
    other = np.array(sent)[60:, 0]
    assert any(link.seen)
    assert np.abs(np.diff(other, 2)).max() <= 40.0 * DT**2 * (1 + 1e-6)
    assert np.abs(other - wanted[60:]).max() < 1e-6


def test_a_law_that_integrates_moves_while_another_element_is_limited() -> None:
    link = Link(Kind.POSITION, resolution=1e-3, size=2)
    for _ in range(1000):
        link.guard.resynchronise(link.left, DT)  # before the law, which reads it back
        link.guard.step(link.applied + np.array([1e-5, 1e-2]), None, DT)
        link.send(np.minimum(np.round(link.applied, 3), [1.0, 0.1]))
    assert link.applied[0] == pytest.approx(1000 * 1e-5, rel=0.01)


def test_a_command_that_leaves_in_the_next_read_is_no_limited_one() -> None:
    link = Link(Kind.POSITION)
    applied, wanted = [np.zeros(1)], []
    for k in range(400):
        wanted.append(0.5 * np.sin(0.04 * k))
        link.cycle(wanted[-1], takes=False)
        link.send(applied[-1])
        applied.append(link.applied.copy())
    assert not any(link.seen)
    assert abs(float(applied[-1][0]) - wanted[-1]) < 1e-6
    for _ in range(20):
        link.cycle(wanted[-1] + 1.0, takes=False)
    link.guard.resynchronise(False, DT)
    assert link.applied[0] == link.sent[0], "and a stall is still found"


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.INTENSITY])
@pytest.mark.parametrize("wrong", [-1.0, 57.3, 1e6])
def test_a_report_in_another_unit_or_sign_moves_nothing_there(kind: Kind, wrong: float) -> None:
    """A driver that reported degrees had its joint at 1e30 rad in 30 cycles, beyond every limit."""
    link = Link(kind)
    for k in range(200):
        before = float(link.applied[0])
        link.cycle(0.5 * np.sin(0.04 * k), takes=False)
        step, most = abs(float(link.applied[0]) - before), RATE[kind] * DT * (1 + 1e-9)
        ended = kind is not Kind.POSITION and abs(link.applied[0]) <= most  # a device may end a velocity or torque
        assert step <= most or ended
        link.send(link.applied * (wrong if k > 60 else 1.0))
    assert abs(link.applied[0]) <= 0.6


@pytest.mark.parametrize("jerk", [None, 4000.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_stall_beyond_a_limit_is_no_end_of_the_way_back(jerk: float | None, side: float) -> None:
    link = Link(Kind.POSITION, jerk=jerk)
    link.guard.reset(np.array([2.3 * side]))
    link.send(link.applied)
    for _ in range(5):
        link.cycle(side)
    stuck = float(link.sent[0])
    assert 2.0 < side * stuck < 2.3
    for _ in range(40):
        link.cycle(side, takes=False)
    link.guard.resynchronise(link.left, DT)
    assert link.applied[0] == stuck
    for _ in range(200):
        before = float(link.applied[0])
        link.cycle(side)
        assert side * link.applied[0] <= side * before + 1e-9
    assert link.applied[0] == pytest.approx(side)
