"""A switch's level counts once it has lasted."""

from __future__ import annotations


class Debounced:
    """One switch.

    Attributes:
        pressed: 1.0 or 0.0, debounced.
        presses: times it was pressed since the beginning.
    """

    def __init__(self, seconds: float) -> None:
        """`seconds`: how long a new level must last."""
        self.pressed = 0.0
        self.presses = 0
        self._settle = round(seconds * 1e9)
        self._level = 0.0
        self._since = 0

    def start(self, level: float) -> None:
        """Takes the level found at opening as it is; that is no press."""
        self.pressed = self._level = level

    def take(self, level: float, at: int) -> None:
        """The switch changed at `at` (ns)."""
        if level != self._level:
            self.settle(at)  # what had lasted until now counts, however late it is looked at
            self._level, self._since = level, at

    def settle(self, now: int) -> None:
        """Lets a level count that has lasted long enough by `now` (ns)."""
        if self._level != self.pressed and now - self._since >= self._settle:
            self.pressed = self._level
            self.presses += int(self.pressed)
