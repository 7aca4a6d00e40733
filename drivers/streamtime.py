"""The time of samples that carry none: their number over a rate, for streams that lose nothing by themselves."""

from __future__ import annotations

from typing import Final

from drivers.devicetime import DeviceTime
from drivers.pause import SAME, Pause

_LEARN: Final = (1, 2, 5, 10, 20, 40)  # s after which the rate is estimated anew, then every 40 s
_END: Final = 0.2  # of that time, at its beginning and at its end
_WRONG: Final = 3e-4  # of the rate: a smaller error is drift


class StreamTime:
    """See the module's text.

    A stream that stood still and goes on either delivers what waited (then its lag melts away as it is read)
    or has lost samples (then its lag stays). Samples behind their count keep their old stamps until the lag
    has stayed for a second: for so long they are taken for old ones.

    Attributes:
        restarts: times the count began anew.
        rate: Hz, as known now.
    """

    def __init__(self, rate: float, learn: bool = False) -> None:
        """
        Args:
            rate: Hz.
            learn: it is known roughly: it is estimated from what comes, the better the longer.
        """
        self.rate = rate
        self.restarts = 0
        self._learn = learn
        self._begin()

    def _begin(self) -> None:
        self._clock = DeviceTime(1e9 / self.rate)
        self._pause = Pause(gap=False)
        # Count and ns of the samples between which the rate is estimated.
        self._first: tuple[int, int] | None = None
        self._last = (0, 0)
        self._begun = 0
        self._estimates = 0

    def stamp(self, count: int, now: int) -> int:
        """When sample number `count` was taken, ns on the loop's clock, never after `now`."""
        stamp = self._clock.stamp(count, now)
        if self._pause.over(self._clock.delay, now):
            self.restarts += 1
            self._begin()
            return self._clock.stamp(count, now)
        if self._learn and self._clock.delay < SAME:
            self._estimate(count, now)
        return stamp

    def _estimate(self, count: int, now: int) -> None:
        if self._first is None or count < self._first[0]:
            self._begun = now
            self._first = self._last = (count, now)
            return
        elapsed = now - self._begun
        length = _LEARN[min(self._estimates, len(_LEARN) - 1)] * 1_000_000_000
        # A sample that was held up would tilt the line: at both ends the one counts that came soonest.
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
            # The lag is known to be small here, so little is lost with the old offset.
            self.rate = rate
            self._clock = DeviceTime(1e9 / rate)
            self._clock.stamp(to_count, end)
            self._clock.stamp(count, now)

    def _sooner(self, one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
        """Which of two samples, (count, ns), came with the smaller delay; the later of two alike."""
        return other if other[1] - one[1] <= (other[0] - one[0]) * 1e9 / self.rate else one
