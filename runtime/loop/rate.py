"""A limit on how often something may happen, on the loop's clock: the same times give the same answers."""

from __future__ import annotations

BURST = 5  # requests that may come at once
EVERY = 200_000_000  # ns after which one more may come


class TokenBucket:
    """Holds up to `BURST` tokens and gets one more each `EVERY` ns. It begins full."""

    def __init__(self) -> None:
        self._level, self._last = BURST * EVERY, 0

    def take(self, now: int) -> bool:
        """Takes a token; False if there is none. `now`: ns."""
        self._level = min(self._level + now - self._last, BURST * EVERY)
        self._last = now
        if self._level < EVERY:
            return False
        self._level -= EVERY
        return True
