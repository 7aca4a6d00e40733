"""A device's own counter or clock, mapped to the loop's clock."""

from __future__ import annotations

from fractions import Fraction
from typing import Final

DRIFT: Final = 200e-6  # s/s: two quartz clocks differ by less
_BACK: Final = 2  # ticks that a counter may run backwards (datagrams that overtake each other)


class DeviceTime:
    """When a sample was taken, by the device's own count, not by when it happened to arrive.

    now - count * tick is the two clocks' offset plus the sample's delay on its way. The smallest seen so far
    is taken for the offset: so a sample that waited in a buffer gets its true age, only the shortest delay
    ever stays hidden. The smallest is forgotten at the rate by which clocks may drift apart.

    Attributes:
        delay: ns that the newest sample took longer than the fastest one.
        restarts: times the counter began anew.
    """

    def __init__(self, tick_ns: float | Fraction, bits: int | None = None) -> None:
        """
        Args:
            tick_ns: ns of one count.
            bits: the counter wraps at 2**bits; None: it never does.
        """
        tick = Fraction(tick_ns).limit_denominator(10**6)
        self._ns, self._per = tick.as_integer_ratio()
        self._wrap = None if bits is None else 1 << bits
        self.delay = 0
        self.restarts = -1
        self.restart()

    def restart(self) -> None:
        """Forgets the offset: the device was opened again, or its counter has been reset."""
        self._count: int | None = None  # unwrapped
        self._offset = 0
        self._seen = 0
        self.restarts += 1

    def stamp(self, count: int, now: int) -> int:
        """When the sample with this count was taken, ns on the loop's clock, never after `now`.

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
