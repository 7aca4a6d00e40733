"""Tells delayed samples from samples of a sender that was paused, whose count stood still meanwhile.

Both look the same at first: a gap, then samples that are older by their numbers than they should be. Delayed
samples arrive faster than they were taken until they have caught up. After a pause of the sender, samples arrive
at their normal rate, and their delay stays constant.
"""

from __future__ import annotations

from typing import Final

GAP: Final = 500_000_000  # ns without a new sample after which the count may have stood still
WATCH: Final = 1_000_000_000  # ns for which the delay must stay the same
SAME: Final = 100_000_000  # ns by which it may change meanwhile; a smaller delay counts as none


class Pause:
    """Watches the delays after a gap."""

    def __init__(self, gap: bool = True) -> None:
        """`gap`: watch only after a gap; False for a sender that loses samples without a gap."""
        self._gap = gap
        self._newest: int | None = None
        self._since: int | None = None
        self._delay = 0

    def over(self, delay: int, now: int) -> bool:
        """Takes a new sample's delay; returns True once it is certain that the count stood still.

        Args:
            delay: ns by which the sample is later, by its number, than the fastest one.
            now: ns on the loop's clock.
        """
        newest, self._newest = self._newest, now
        if newest is not None and (now - newest > GAP or (not self._gap and self._since is None)):
            self._since, self._delay = now, delay
        if self._since is None:
            return False
        if delay < SAME:
            self._since = None
            return False
        if abs(delay - self._delay) > SAME:
            self._since, self._delay = now, delay
        if now - self._since < WATCH:
            return False
        self._since = None
        return True
