"""Whether a stream brings as many samples as it says."""

from __future__ import annotations

from typing import Final

WINDOW: Final = 2_000_000_000  # ns over which the rate is counted
SLOW: Final = 0.8  # of the rate; what is beyond these two isn't drift
FAST: Final = 1.25


class Rate:
    """Whether a regular stream brings as many samples as it says."""

    def __init__(self, rate: float) -> None:
        """`rate`: Hz."""
        self._rate = rate
        self._since: tuple[int, int] | None = None

    def wrong(self, number: int, arrived: int) -> float | None:
        """Takes the newest sample's number and arrival (ns). Returns the rate found (Hz) where it is another."""
        if self._since is None:
            self._since = number, arrived
        started, since = self._since
        if arrived - since < WINDOW:
            return None
        self._since = number, arrived
        found = (number - started) / (arrived - since) * 1e9
        return None if SLOW * self._rate <= found <= FAST * self._rate else found
