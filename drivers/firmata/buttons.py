"""Buttons from port messages, debounced."""

from __future__ import annotations

from collections.abc import Sequence

from srl.drivers.debounce import Debounced


class Buttons:
    """Debounced buttons to ground: a pin that reads 0 is a pressed button.

    Attributes:
        ports: the ports (eight pins each) of the buttons.
    """

    def __init__(self, pins: Sequence[int], debounce: Sequence[float]) -> None:
        """
        Args:
            pins: digital pin numbers.
            debounce: s, for each.
        """
        self.ports = tuple(sorted({pin // 8 for pin in pins}))
        self._switches = [
            (pin // 8, 1 << pin % 8, Debounced(seconds)) for pin, seconds in zip(pins, debounce, strict=True)
        ]

    @property
    def pressed(self) -> list[float]:
        """1.0 or 0.0 for each button, debounced."""
        return [switch.pressed for _, _, switch in self._switches]

    def start(self, masks: dict[int, int]) -> None:
        """Takes over the levels found at opening, by port."""
        for port, bit, switch in self._switches:
            switch.start(0.0 if masks[port] & bit else 1.0)

    def take(self, port: int, mask: int, now: int) -> None:
        """Takes one port message, seen at `now` (ns)."""
        for where, bit, switch in self._switches:
            if where == port:
                switch.take(0.0 if mask & bit else 1.0, now)

    def settle(self, now: int) -> None:
        """Accepts levels that have lasted their debounce time by `now` (ns)."""
        for _, _, switch in self._switches:
            switch.settle(now)
