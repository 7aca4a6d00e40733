"""Tells samples that were held back on their way from a count that stood still while their sender was paused.

Both look alike at first: a gap, then samples that are older by their numbers than they should be. Held-back ones
come faster than they were taken until they have caught up. After a pause they come at their own pace, and their
delay stays what it is.
"""

from __future__ import annotations

from typing import Final

GAP: Final = 500_000_000  # ns without a new sample after which the count may have stood still
WATCH: Final = 1_000_000_000  # ns that the delay must stay the same
SAME: Final = 100_000_000  # ns by which it may change meanwhile; a smaller delay is none


class Pause:
    """Watches the delays after a gap."""

    def __init__(self, gap: bool = True) -> None:
        """`gap`: only a gap makes it watch; False for a sender that loses samples without one."""
        self._gap = gap
        self._newest: int | None = None
        self._since: int | None = None
        self._delay = 0

    def over(self, delay: int, now: int) -> bool:
        """Takes a new sample's delay; True once it is sure that the count stood still.

        Args:
            delay: ns that it is later, by its number, than the fastest one was.
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
