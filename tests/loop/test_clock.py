"""The clocks: exact phase, missed periods counted, a silent robot survived. Nothing here asserts a speed."""

from __future__ import annotations

import socket
import time
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.contracts.world import World, WorldConfig
from runtime.loop.clock import SECOND, DeviceClock, MonotonicClock, SimClock


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
    begun = time.monotonic_ns()
    for _ in range(20):
        tick = clock.wait()
    assert world.time == pytest.approx(tick.deadline - begun, abs=6_000_000)


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
    begun = time.monotonic_ns()
    clock.wait()
    clock.wait()
    ours.close()
    assert time.monotonic_ns() - begun >= 9_000_000
