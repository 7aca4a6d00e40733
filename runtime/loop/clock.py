"""What the loop waits for: the monotonic clock, the simulated world, or a robot's own tick."""

from __future__ import annotations

import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from runtime.contracts.world import World

SECOND = 1_000_000_000
# Waking from a sleep takes some tens of microseconds; the rest of the wait is spun away.
SPIN = 60_000


@dataclass(slots=True)
class Tick:
    """One wake-up.

    Attributes:
        now: ns on the loop's clock: the time that stamps and ages are measured in.
        dt: ns since the tick before, by deadlines: a multiple of the period where some were missed.
        deadline: when this tick was due, CLOCK_MONOTONIC ns.
        missed: periods that passed without a tick.
    """

    now: int = 0
    dt: int = 0
    deadline: int = 0
    missed: int = 0


class Clock(ABC):
    """Paces the loop. `wait` returns the same `Tick` each time, refilled."""

    def __init__(self, rate: Fraction) -> None:
        self.rate = rate
        self.period = round(SECOND / rate)
        self.tick = Tick()

    @abstractmethod
    def start(self) -> None:
        """Sets the phase: the first tick is due one period from now."""

    @abstractmethod
    def wait(self) -> Tick:
        """Waits until the next tick is due."""

    def deadline_of(self, start: int, count: int) -> int:
        """When tick number `count` is due: exact for rates whose period isn't whole nanoseconds."""
        return start + count * SECOND * self.rate.denominator // self.rate.numerator


class MonotonicClock(Clock):
    """Absolute deadlines on CLOCK_MONOTONIC that keep their phase; sleeps, then spins the last stretch."""

    def start(self) -> None:
        self._start = time.monotonic_ns()
        self._count = 0
        self.tick.deadline = self._start

    def wait(self) -> Tick:
        tick = self.tick
        last = tick.deadline
        self._count += 1
        deadline = self.deadline_of(self._start, self._count)
        now = time.monotonic_ns()
        tick.missed = 0
        if now > deadline + self.period:
            # Too late for one or more whole periods: take the newest deadline that has passed, keep the phase.
            behind = (now - self._start) * self.rate.numerator // (SECOND * self.rate.denominator)
            tick.missed = behind - self._count
            self._count = behind
            deadline = self.deadline_of(self._start, behind)
        elif (rest := deadline - now - SPIN) > 0:
            time.sleep(rest / SECOND)
        while (now := time.monotonic_ns()) < deadline:
            pass
        tick.now, tick.dt, tick.deadline = now, deadline - last, deadline
        return tick


class SimClock(Clock):
    """Steps the simulated world by one period a tick: as fast as it goes, or paced by another clock.

    Unpaced, `now` is the world's time and every run with the same seed gives the same bits. Paced, `now` is
    CLOCK_MONOTONIC, so that real devices may take part.
    """

    def __init__(
        self, rate: Fraction, world: World, pace: Clock | None = None, throttle: Callable[[], None] | None = None
    ) -> None:
        """`pace`: the monotonic clock, or a real robot's; `throttle` is called before each unpaced tick and may
        wait for slower readers of the rows."""
        super().__init__(rate)
        self.world = world
        self._throttle = throttle
        self._pace = pace

    def start(self) -> None:
        self._count = 0
        if self._pace is not None:
            self._pace.start()

    def wait(self) -> Tick:
        tick = self.tick
        if self._pace is not None:
            paced = self._pace.wait()
            tick.now, tick.dt, tick.deadline, tick.missed = paced.now, paced.dt, paced.deadline, paced.missed
            self._count += 1 + paced.missed
        else:
            if self._throttle is not None:
                self._throttle()
            self._count += 1
        # The world keeps its own time, from 0; a real device's delays don't stretch it.
        until = self.deadline_of(0, self._count)
        if self._pace is None:
            tick.deadline = time.monotonic_ns()
            tick.now, tick.dt = until, until - self.deadline_of(0, self._count - 1)
        self.world.advance(until)
        return tick


class DeviceClock(Clock):
    """Paced by a robot's own tick: wakes when its descriptor has something to read.

    A silent robot can't take the other devices' checks with it: after 1.5 periods without a tick the loop
    goes on by the monotonic clock until the robot speaks again. A backlog is the driver's business: it reads
    all there is and keeps the newest.
    """

    def __init__(self, rate: Fraction, fileno: Callable[[], int | None]) -> None:
        """`fileno` gives the descriptor to wait on; None while the robot is away."""
        super().__init__(rate)
        self._fileno = fileno
        self._poll = select.poll()
        self._registered: int | None = None
        self.silent = 0  # ticks that came from the monotonic clock

    def start(self) -> None:
        self.tick.deadline = time.monotonic_ns()

    def wait(self) -> Tick:
        tick = self.tick
        last = tick.deadline
        self._register()
        limit = last + self.period * 3 // 2
        heard = gone = False
        while not heard and (rest := limit - time.monotonic_ns()) > 0:
            if self._registered is None or gone:
                time.sleep(rest / SECOND)
                continue
            for _, event in self._poll.poll(rest / 1e6):
                # A link that has hung up is always readable: that is no tick, and no reason to spin.
                gone = bool(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL))
                heard = not gone
        # A descriptor that nobody drains must not make the loop spin.
        if heard and (early := last + self.period // 2 - time.monotonic_ns()) > 0:
            time.sleep(early / SECOND)
        now = time.monotonic_ns()
        if heard:
            tick.deadline = now
        else:
            # One period on from the last tick; the half period was grace.
            self.silent += 1
            tick.deadline = last + self.period if now < last + 2 * self.period else now
        tick.now, tick.dt = now, tick.deadline - last
        tick.missed = max(0, round(tick.dt / self.period) - 1)
        return tick

    def _register(self) -> None:
        """A robot that was opened again may have another descriptor."""
        fileno = self._fileno()
        if fileno is not None and fileno < 0:
            fileno = None
        if fileno == self._registered:
            return
        if self._registered is not None:
            self._poll = select.poll()
        if fileno is not None:
            self._poll.register(fileno, select.POLLIN)
        self._registered = fileno
