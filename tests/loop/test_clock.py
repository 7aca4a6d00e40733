"""The clocks: exact phase, missed periods counted, a silent robot survived. Nothing here asserts a speed."""

from __future__ import annotations

import select
import signal
import socket
import subprocess
import sys
import time
from fractions import Fraction

import numpy as np
import pytest
from helpers import environment
from numpy.typing import NDArray

from srl.runtime.contracts.world import World, WorldConfig
from srl.runtime.loop import clock as clock_module
from srl.runtime.loop import realtime
from srl.runtime.loop.clock import SECOND, Clock, DeviceClock, MonotonicClock, SimClock
from srl.runtime.service import supervisor


class Still(World):
    """A world in which nothing happens but time."""

    def __init__(self) -> None:
        super().__init__(WorldConfig(), 0)
        self.calls: list[int] = []

    def advance(self, until: int) -> None:
        self.time = until
        self.calls.append(until)

    def save(self) -> NDArray[np.float64]:
        return np.array([float(self.time)])

    def restore(self, state: NDArray[np.float64]) -> None:
        self.time = int(state[0])


@pytest.mark.parametrize("rate", [Fraction(60), Fraction(90), Fraction(120), Fraction(1000, 3), Fraction(125)])
def test_deadlines_of_odd_rates_dont_drift(rate: Fraction) -> None:
    clock = MonotonicClock(rate)
    cycles = 10_000_000
    exact = cycles * SECOND / rate
    assert abs(clock.deadline_of(0, cycles) - exact) < 1


def test_ticks_come_at_their_deadlines_and_never_before() -> None:
    clock = MonotonicClock(Fraction(500))
    clock.start()
    deadlines = []
    for _ in range(100):
        tick = clock.wait()
        assert tick.now >= tick.deadline
        assert tick.dt == pytest.approx(2_000_000 * (1 + tick.missed), abs=1)
        deadlines.append(tick.deadline)
    phase = [(d - deadlines[0]) % 2_000_000 for d in deadlines]
    assert max(min(p, 2_000_000 - p) for p in phase) <= 1


def test_missed_periods_are_counted_and_the_phase_is_kept() -> None:
    clock = MonotonicClock(Fraction(1000))
    clock.start()
    first = clock.wait().deadline
    time.sleep(0.0105)
    tick = clock.wait()
    assert tick.missed >= 9
    assert tick.dt == (tick.missed + 1) * 1_000_000
    assert (tick.deadline - first) % 1_000_000 == 0


def test_simulated_time_is_the_same_in_every_run() -> None:
    runs = []
    for _ in range(2):
        world = Still()
        clock = SimClock(Fraction(1000, 3), world)
        clock.start()
        ticks = [(t.now, t.dt, t.missed) for t in (clock.wait() for _ in range(1000))]
        assert world.time == 3 * SECOND
        assert sum(dt for _, dt, _ in ticks) == 3 * SECOND
        runs.append(ticks)
    assert runs[0] == runs[1]


def test_a_paced_world_keeps_up_with_the_wall() -> None:
    world = Still()
    clock = SimClock(Fraction(200), world, MonotonicClock(Fraction(200)))
    clock.start()
    started = time.monotonic_ns()
    for _ in range(20):
        tick = clock.wait()
    assert world.time == pytest.approx(tick.deadline - started, abs=6_000_000)


def test_a_robots_tick_paces_the_loop_and_its_silence_does_not_stop_it() -> None:
    robot, ours = socket.socketpair()
    ours.setblocking(False)
    clock = DeviceClock(Fraction(100), ours.fileno)
    clock.start()
    for _ in range(5):
        robot.send(b"tick")
        clock.wait()
        assert ours.recv(100) == b"tick"
    assert clock.silent == 0
    dts = [clock.wait().dt for _ in range(4)]  # silence
    assert clock.silent == 4
    assert all(dt >= 10_000_000 for dt in dts)
    robot.send(b"tick")
    clock.wait()
    assert clock.silent == 4
    robot.close()  # hung up: always readable, yet the loop mustn't spin
    ours.recv(100)
    started = time.monotonic_ns()
    clock.wait()
    clock.wait()
    ours.close()
    assert time.monotonic_ns() - started >= 9_000_000


class FakeTime:
    """A clock of the test's own, in place of the module `time`: sleeping and computing pass it on."""

    def __init__(self) -> None:
        self.now = 1_000_000_000
        self.slept = 0

    def monotonic_ns(self) -> int:
        self.now += 100  # so that spinning ends
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept += round(seconds * SECOND)
        self.now += round(seconds * SECOND)


class AlwaysReady:
    """A robot whose data is always waiting: the poll never blocks."""

    def register(self, *_: object) -> None: ...

    def poll(self, _: float) -> list[tuple[int, int]]:
        return [(0, select.POLLIN)]


@pytest.mark.parametrize("kind", [MonotonicClock, DeviceClock])
@pytest.mark.parametrize("length", [0.0007, 0.0015, 0.03])  # s of computing in a period of 1 ms
def test_a_loop_that_is_always_late_leaves_the_processor_to_others(
    kind: type[Clock], length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel takes the processor from real-time processes that use more than 0.95 of a second."""
    fake = FakeTime()
    monkeypatch.setattr(clock_module, "time", fake)
    rate = Fraction(1000)
    clock = DeviceClock(rate, lambda: 0) if kind is DeviceClock else MonotonicClock(rate)
    if isinstance(clock, DeviceClock):
        clock._poll, clock._registered = AlwaysReady(), 0  # type: ignore[assignment]
    clock.start()
    started, awake = fake.now, fake.now
    while fake.now < started + 3 * SECOND:
        slept = fake.slept
        clock.wait()
        if fake.slept > slept:
            awake = fake.now
        fake.now += round(length * SECOND)
        assert fake.now - awake < 100_000_000, "never long without a sleep: the supervisor may need this processor"
    assert fake.slept / (fake.now - started) > 0.055


def test_a_single_late_cycle_costs_no_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = FakeTime()
    monkeypatch.setattr(clock_module, "time", fake)
    clock = MonotonicClock(Fraction(100))
    clock.start()
    for _ in range(10):
        clock.wait()
        fake.now += 2_000_000
    fake.now += 18_000_000
    slept = fake.slept
    assert clock.wait().missed == 1
    assert fake.slept == slept


STUCK = """
import os, sys
from srl.runtime.loop import realtime
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
except PermissionError:
    sys.exit("refused")
realtime.enter(50_000_000)
print("entered", flush=True)
if sys.argv[1] == "leave":
    realtime.leave()
    end = __import__("time").process_time() + 0.2
    while __import__("time").process_time() < end:
        pass
    sys.exit("left")
while True:
    pass
"""


@pytest.mark.parametrize(("what", "code"), [("spin", -signal.SIGXCPU), ("leave", 1)])
def test_a_loop_stuck_in_one_call_is_ended_by_the_kernel(what: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STUCK, what], env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    if done.stderr == "refused\n":
        pytest.skip("no real-time priority here")
    assert done.returncode == code, done.stderr


MUCH = """
import gc, os, sys, time
from srl.runtime.loop import realtime
much, took = [], 0.0
while took < 0.1:  # s: what `enter` does before the first cycle takes longer than the limit below, on any machine
    much += [[] for _ in range(1_000_000)]
    begun = time.process_time()
    gc.collect()
    took = time.process_time() - begun
refused = realtime.enter(50_000_000)
time.sleep(0.001)
realtime.leave()  # it takes long to free, too
sys.exit("refused" if any("priority" in text for text in refused) else 0)
"""


@pytest.mark.slow
def test_what_takes_long_before_the_first_cycle_doesnt_count_as_stuck() -> None:
    done = subprocess.run(
        [sys.executable, "-c", MUCH], env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    if done.stderr == "refused\n":
        pytest.skip("no real-time priority here")
    assert done.returncode == 0, (done.returncode, done.stderr)


def test_the_supervisor_acts_before_the_kernel_does() -> None:
    assert realtime.STUCK > supervisor.HUNG
