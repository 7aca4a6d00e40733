"""Debouncing of switches: a new level counts once it has lasted for a given time."""

from __future__ import annotations


class Debounced:
    """One switch.

    Attributes:
        pressed: 1.0 or 0.0, debounced.
        presses: number of presses since the beginning.
    """

    def __init__(self, seconds: float) -> None:
        """`seconds`: how long a new level must last."""
        self.pressed = 0.0
        self.presses = 0
        self._settle = round(seconds * 1e9)
        self._level = 0.0
        self._since = 0

    def start(self, level: float) -> None:
        """Takes over the level found at opening. This doesn't count as a press."""
        self.pressed = self._level = level

    def take(self, level: float, at: int) -> None:
        """Takes the switch's new level, which began at `at` (ns)."""
        if level != self._level:
            self.settle(at)  # the previous level counts if it lasted until now, even if nobody looked in between
            self._level, self._since = level, at

    def settle(self, now: int) -> None:
        """Accepts a new level that has lasted long enough by `now` (ns)."""
        if self._level != self.pressed and now - self._since >= self._settle:
            self.pressed = self._level
            self.presses += int(self.pressed)
