"""Time stamps for samples that carry none: number divided by rate, for streams that lose no samples themselves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from srl.drivers.devicetime import DeviceTime
from srl.drivers.pause import SAME, Pause
from srl.runtime.contracts.driver import Health
from srl.runtime.contracts.errors import DeviceLostError

_LEARN: Final = (1, 2, 5, 10, 20, 40)  # s after which the rate is estimated anew, then every 40 s
_END: Final = 0.2  # fraction of that time, at its beginning and at its end
_WRONG: Final = 3e-4  # relative error of the rate; a smaller error is drift


LATE: Final = SAME  # ns by which samples may be late for some time: less can't be told from a rate that is wrong
ENDURED: Final = 5_000_000_000  # ns of late samples after which a link is opened anew: that leaves the queue behind


def measured_rate(times: Sequence[float], counts: Sequence[int]) -> float:
    """Returns the rate, Hz, of samples that came at `times` (s, rising), by their `counts`; 0 where it isn't seen.

    A sample may be held up, never early. So the longest edge of the lower convex hull of time over count is taken:
    what was held up lies above it. A line through the first and the last sample may be too steep by more than
    `StreamTime` gets over: samples would seem ever later, and only from those on time the rate is learnt.
    """
    hull: list[tuple[float, int]] = []
    for at, count in zip(times, counts, strict=True):
        if hull and count <= hull[-1][1]:
            continue  # a datagram that was overtaken
        while len(hull) > 1 and _interval(hull[-2], hull[-1]) >= _interval(hull[-2], (at, count)):
            del hull[-1]
        hull.append((at, count))
    edges = list(pairwise(hull))
    if not edges:
        return 0.0
    interval = _interval(*max(edges, key=lambda edge: (edge[1][0] - edge[0][0]) * (edge[1][1] - edge[0][1])))
    return 1.0 / interval if interval > 0.0 else 0.0


def _interval(one: tuple[float, int], other: tuple[float, int]) -> float:
    """Returns the s from count to count, between two samples (s, count)."""
    return (other[0] - one[0]) / (other[1] - one[1])


class Lateness:
    """Says when late samples have been borne long enough; for links that lose none unseen."""

    def __init__(self) -> None:
        self._since = -1  # ns; -1: they aren't late

    def check(self, delay: int, now: int, place: str, health: Health) -> None:
        """Takes a sample's delay and the time, ns. Raises DeviceLostError once samples were late for five seconds."""
        if delay < LATE:
            self._since = -1
        elif self._since < 0:
            self._since = now
        elif now - self._since > ENDURED:
            health.lost(f"its samples are {delay * 1e-9:.1f} s late")
            raise DeviceLostError(place, health.message, "It is opened anew, without what waits there")


class StreamTime:
    """Computes the time of a sample from its number; see the module's docstring.

    After a stall a stream either delivers the samples that waited or has lost samples. In the first case its lag
    shrinks as they are read; in the second the lag stays. Late samples keep their old stamps until the lag has
    stayed for one second: until then they are taken for samples that waited.

    Where no sample can be lost unseen (over TCP, or numbered by the sender) a lag that stays is a queue that stays.
    Then the samples remain as old as they are.

    Attributes:
        restarts: number of times the count began anew.
        rate: Hz, the present estimate.
        lossless: as given at the beginning.
    """

    def __init__(self, rate: float, learn: bool = False, lossless: bool = False) -> None:
        """
        Args:
            rate: Hz.
            learn: the rate is known only roughly; it is estimated from the samples, the better the longer.
            lossless: no sample is lost unseen; see above.
        """
        self.rate = rate
        self.restarts = 0
        self.lossless, self._learn = lossless, learn
        self._begin()

    def _begin(self) -> None:
        self._clock = DeviceTime(1e9 / self.rate)
        self._pause = Pause(gap=False)
        # Count and time (ns) of the two samples between which the rate is estimated.
        self._first: tuple[int, int] | None = None
        self._last = (0, 0)
        self._started = 0
        self._estimates = 0

    @property
    def delay(self) -> int:
        """ns by which the newest sample was slower than the fastest one."""
        return self._clock.delay

    def stamp(self, count: int, now: int) -> int:
        """Returns when sample number `count` was taken, in ns on the loop's clock; never after `now`."""
        stamp = self._clock.stamp(count, now)
        if not self.lossless and self._pause.over(self._clock.delay, now):
            self.restarts += 1
            self._begin()
            return self._clock.stamp(count, now)
        if self._learn and self._clock.delay < SAME:
            self._estimate(count, now)
        return stamp

    def _estimate(self, count: int, now: int) -> None:
        if self._first is None or count < self._first[0]:
            self._started = now
            self._first = self._last = (count, now)
            return
        elapsed = now - self._started
        length = _LEARN[min(self._estimates, len(_LEARN) - 1)] * 1_000_000_000
        # A delayed sample would tilt the line. So at both ends the sample with the smallest delay is used.
        if elapsed < _END * length:
            self._first = self._last = self._sooner(self._first, (count, now))
            return
        if elapsed < (1.0 - _END) * length:
            return
        self._last = (count, now) if self._last == self._first else self._sooner(self._last, (count, now))
        if elapsed < length:
            return
        (from_count, start), (to_count, end) = self._first, self._last
        rate = (to_count - from_count) / (end - start) * 1e9
        self._estimates += 1
        self._last = self._first
        if self._estimates >= len(_LEARN):
            self._first = None
        if rate > 0 and abs(rate / self.rate - 1) > _WRONG:
            # The lag is known to be small here, so losing the old offset costs little.
            self.rate = rate
            self._clock = DeviceTime(1e9 / rate)
            self._clock.stamp(to_count, end)
            self._clock.stamp(count, now)

    def _sooner(self, one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
        """Returns the one of two samples (count, ns) with the smaller delay; the later one if both are equal."""
        return other if other[1] - one[1] <= (other[0] - one[0]) * 1e9 / self.rate else one
