"""Buttons from port messages: each one's level counts once it has lasted."""

from __future__ import annotations

from collections.abc import Sequence


class Buttons:
    """Debounced buttons to ground: a pin that reads 0 is a pressed button.

    Attributes:
        pressed: 1.0 or 0.0 for each button, debounced.
        ports: the ports (eight pins each) they are on.
    """

    def __init__(self, pins: Sequence[int], debounce: Sequence[float]) -> None:
        """
        Args:
            pins: digital pin numbers.
            debounce: s, for each.
        """
        self.pressed = [0.0] * len(pins)
        self.ports = tuple(sorted({pin // 8 for pin in pins}))
        self._where = [(pin // 8, 1 << pin % 8) for pin in pins]
        self._settle = [round(seconds * 1e9) for seconds in debounce]
        self._level = [0.0] * len(pins)
        self._since = [0] * len(pins)

    def start(self, masks: dict[int, int]) -> None:
        """Takes the levels found at opening, by port, as they are."""
        for i, (port, bit) in enumerate(self._where):
            self._level[i] = self.pressed[i] = 0.0 if masks[port] & bit else 1.0

    def take(self, port: int, mask: int, now: int) -> None:
        """One port message, seen at `now` (ns)."""
        for i, (where, bit) in enumerate(self._where):
            if where == port:
                level = 0.0 if mask & bit else 1.0
                if level != self._level[i]:
                    self._level[i] = level
                    self._since[i] = now

    def settle(self, now: int) -> None:
        """Lets levels count that have lasted their debounce time by `now` (ns)."""
        if self._level != self.pressed:
            for i, level in enumerate(self._level):
                if now - self._since[i] >= self._settle[i]:
                    self.pressed[i] = level
