"""A device's own counter or clock, mapped to the loop's clock."""

from __future__ import annotations

from fractions import Fraction
from typing import Final

DRIFT: Final = 200e-6  # s/s: two quartz clocks differ by less
_BACK: Final = 2  # ticks that a counter may run backwards (datagrams that overtake each other)


class DeviceTime:
    """Converts a device's own count into the time at which a sample was taken (not the time it arrived).

    now - count * tick is the offset between the two clocks plus the sample's transport delay. The smallest value
    seen so far is used as the offset. So a sample that waited in a buffer gets its true age; only the shortest
    delay always stays hidden. The smallest value grows at the rate by which the clocks may drift apart.

    Attributes:
        delay: ns by which the newest sample was slower than the fastest one.
        restarts: number of times the counter began anew.
    """

    def __init__(self, tick_ns: float | Fraction, bits: int | None = None) -> None:
        """
        Args:
            tick_ns: ns of one count.
            bits: the counter wraps at 2**bits; None if it never wraps.
        """
        tick = Fraction(tick_ns).limit_denominator(10**6)
        self._ns, self._per = tick.as_integer_ratio()
        self._wrap = None if bits is None else 1 << bits
        self.delay = 0
        self.restarts = -1
        self.restart()

    def restart(self) -> None:
        """Forgets the offset, because the device was opened again or its counter was reset."""
        self._count: int | None = None  # unwrapped
        self._offset = 0
        self._seen = 0
        self.restarts += 1

    def stamp(self, count: int, now: int) -> int:
        """Returns when the sample with this count was taken, in ns on the loop's clock; never after `now`.

        Args:
            count: the device's counter.
            now: ns on the loop's clock, when the sample was found.
        """
        if self._count is not None:
            step = count - self._count
            if self._wrap is not None:
                step = (step + self._wrap // 2) % self._wrap - self._wrap // 2
            if step < -_BACK:
                self.restart()
            else:
                count = self._count + step
        at = count * self._ns // self._per
        offset = now - at
        if self._count is None:
            self._offset = offset
        else:
            self._offset = min(offset, self._offset + round(max(now - self._seen, 0) * DRIFT))
        self._count = count if self._count is None else max(count, self._count)
        self._seen = now
        self.delay = offset - self._offset
        return at + self._offset
