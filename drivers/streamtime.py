"""The time of samples that carry none: their number over a rate, for streams that lose nothing by themselves."""

from __future__ import annotations

from typing import Final

from drivers.devicetime import DeviceTime

LATE: Final = 200_000_000  # ns behind what the count says: samples were lost, or wait somewhere
STEADY: Final = 1_000_000_000  # ns of that without a change: they were lost, the count begins anew
_LEARN: Final = (1, 2, 5, 10, 20, 40)  # s after which the rate is estimated anew, then every 40 s
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
        self._since = 0  # ns: when the lag appeared; 0: there is none
        self._lag = 0
        self._first: tuple[int, int] | None = None  # count and ns, where the estimate begins
        self._estimates = 0

    def stamp(self, count: int, now: int) -> int:
        """When sample number `count` was taken, ns on the loop's clock, never after `now`."""
        stamp = self._clock.stamp(count, now)
        lag = self._clock.delay
        if lag < LATE:
            self._since = 0
            if self._learn:
                self._estimate(count, now)
        elif not self._since or lag < self._lag - LATE // 2:
            self._since, self._lag = now, lag
        elif now - self._since > STEADY:
            self.restarts += 1
            self._begin()
            return self._clock.stamp(count, now)
        return stamp

    def _estimate(self, count: int, now: int) -> None:
        if self._first is None or count < self._first[0]:
            self._first = (count, now)
            return
        elapsed = now - self._first[1]
        if elapsed < _LEARN[min(self._estimates, len(_LEARN) - 1)] * 1_000_000_000:
            return
        rate = (count - self._first[0]) / elapsed * 1e9
        self._estimates += 1
        if self._estimates >= len(_LEARN):
            self._first = (count, now)
        if rate > 0 and abs(rate / self.rate - 1) > _WRONG:
            # The lag is known to be small here, so little is lost with the old offset.
            self.rate = rate
            self._clock = DeviceTime(1e9 / rate)
            self._clock.stamp(count, now)
