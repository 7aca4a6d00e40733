"""The clocks that the loop waits for: the monotonic clock, the simulated world, or a robot's own tick."""

from __future__ import annotations

import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from srl.runtime.contracts.world import World

SECOND = 1_000_000_000
# ns before the deadline at which the loop stops sleeping and spins: waking up takes some tens of microseconds.
SPIN = 60_000
# A loop that is always late must not keep its processor for itself: the supervisor may need it, and the kernel takes it
# away for 50 ms or more once real-time processes have had it for 0.95 s (sched_rt_runtime_us).
BREATH = 25_000_000  # ns of computing, at most, between two sleeps
SHARE = 15  # ns of computing for one ns of sleep, at most, over such a time


@dataclass(slots=True)
class Tick:
    """One wake-up.

    Attributes:
        now: ns on the loop's clock, which stamps and ages refer to.
        dt: ns from the previous deadline to this one: a multiple of the period where ticks were missed.
        deadline: when this tick was due, CLOCK_MONOTONIC ns.
        missed: number of periods that passed without a tick.
    """

    now: int = 0
    dt: int = 0
    deadline: int = 0
    missed: int = 0


class Clock(ABC):
    """Paces the loop. `wait` fills and returns the same `Tick` object each time."""

    def __init__(self, rate: Fraction) -> None:
        self.rate = rate
        self.period = round(SECOND / rate)
        self.tick = Tick()
        self._woke = 0
        self._owed = 0  # ns of computing for which there was no sleep yet

    @abstractmethod
    def start(self) -> None:
        """Sets the phase: the first tick is due one period from now."""

    @abstractmethod
    def wait(self) -> Tick:
        """Waits until the next tick is due."""

    def breathe(self) -> None:
        """For work that goes on over many periods: to be called in it, else its sleep is had at once in `wait`."""
        self._breathe(time.monotonic_ns())

    def _breathe(self, started: int) -> None:
        """Ends a wait that began at `started` (CLOCK_MONOTONIC ns): sleeps on where sleep is overdue."""
        now = time.monotonic_ns()
        if self._woke:
            self._owed = max(0, self._owed + (started - self._woke) - SHARE * (now - started))
        if self._owed > BREATH:
            time.sleep(self._owed / SHARE / SECOND)
            self._owed, now = 0, time.monotonic_ns()
        self._woke = now

    def deadline_of(self, start: int, count: int) -> int:
        """When tick number `count` is due. Exact also for rates whose period is not a whole number of ns."""
        return start + count * SECOND * self.rate.denominator // self.rate.numerator


class MonotonicClock(Clock):
    """Waits for absolute deadlines on CLOCK_MONOTONIC, which keep their phase. It sleeps first and spins at the end."""

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
        if (rest := deadline - now - SPIN) > 0:
            time.sleep(rest / SECOND)
        self._breathe(now)
        while (now := time.monotonic_ns()) < deadline:
            pass
        tick.missed = 0
        if now > deadline + self.period:
            # Late by one or more whole periods: take the newest deadline that has passed and keep the phase.
            behind = (now - self._start) * self.rate.numerator // (SECOND * self.rate.denominator)
            tick.missed = behind - self._count
            self._count = behind
            deadline = self.deadline_of(self._start, behind)
        tick.now, tick.dt, tick.deadline = now, deadline - last, deadline
        return tick


class SimClock(Clock):
    """Steps the simulated world by one period a tick, as fast as possible or paced by another clock.

    Unpaced, `now` is the world's time, and every run with the same seed gives the same result bit for bit.
    Paced, `now` is CLOCK_MONOTONIC, so that real devices can take part.
    """

    def __init__(
        self, rate: Fraction, world: World, pace: Clock | None = None, throttle: Callable[[], None] | None = None
    ) -> None:
        """`pace` is the monotonic clock or a real robot's clock.

        `throttle` is called before each unpaced tick and may wait for slower readers of the rows.
        """
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
        # The world has its own time, which begins at 0. Delays of a real device do not stretch it.
        until = self.deadline_of(0, self._count)
        if self._pace is None:
            tick.deadline = time.monotonic_ns()
            tick.now, tick.dt = until, until - self.deadline_of(0, self._count - 1)
        self.world.advance(until)
        return tick


class DeviceClock(Clock):
    """Waits for a robot's own tick: it wakes when the robot's descriptor has data to read.

    A silent robot does not block the checks of the other devices. After 1.5 periods without a tick the loop
    continues by the monotonic clock until the robot sends again. The driver handles a backlog: it reads all
    data and keeps the newest.
    """

    def __init__(self, rate: Fraction, fileno: Callable[[], int | None]) -> None:
        """`fileno` returns the descriptor to wait on; None while the robot is lost."""
        super().__init__(rate)
        self._fileno = fileno
        self._poll = select.poll()
        self._registered: int | None = None
        self.silent = 0  # number of ticks from the monotonic clock

    def start(self) -> None:
        self.tick.deadline = time.monotonic_ns()

    def wait(self) -> Tick:
        tick = self.tick
        last = tick.deadline
        self._register()
        started = time.monotonic_ns()
        limit = last + self.period * 3 // 2
        heard = gone = False
        while not heard and (rest := limit - time.monotonic_ns()) > 0:
            if self._registered is None or gone:
                time.sleep(rest / SECOND)
                continue
            for _, event in self._poll.poll(rest / 1e6):
                # A link that has hung up is always readable. This is not a tick, and the loop must not spin on it.
                gone = bool(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL))
                heard = not gone
        # A descriptor that nobody reads must not make the loop spin.
        if heard and (early := last + self.period // 2 - time.monotonic_ns()) > 0:
            time.sleep(early / SECOND)
        self._breathe(started)
        now = time.monotonic_ns()
        if heard:
            tick.deadline = now
        else:
            # The tick was due one period after the last one; the half period was tolerance.
            self.silent += 1
            tick.deadline = last + self.period if now < last + 2 * self.period else now
        tick.now, tick.dt = now, tick.deadline - last
        tick.missed = max(0, round(tick.dt / self.period) - 1)
        return tick

    def _register(self) -> None:
        """Registers the robot's descriptor again if it has changed, as it may after a reopening."""
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
