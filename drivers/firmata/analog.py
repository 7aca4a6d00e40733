"""Analog inputs: readings of 10 bits, in the profile's unit, and when the oldest of them was heard."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from srl.drivers.firmata.config import FIRST_ANALOG, AnalogConfig

FULL: Final = 1023  # the reading at the board's supply
_OLD: Final = 5  # intervals without a reading after which an input isn't measured


class Analog:
    """The inputs of one board.

    Attributes:
        channels: of the inputs, in their order: 0 is A0.
        values: the newest of each, in the unit.
        problem: why the newest reading that was none is none.
    """

    def __init__(self, inputs: Mapping[str, AnalogConfig], interval: float) -> None:
        """`interval`: s between two readings."""
        self._inputs = list(inputs.items())
        self.channels = [entry.pin - FIRST_ANALOG for entry in inputs.values()]
        self.values = [0.0] * len(self.channels)
        self.problem = ""
        self._heard = [-1] * len(self.channels)
        self._interval = interval

    @property
    def stamp(self) -> int:
        """ns, when the oldest of the newest readings came; -1: not all have come."""
        return min(self._heard)

    @property
    def max_age(self) -> float:
        """s after which an input isn't measured any more."""
        return max(_OLD * self._interval, 0.2)

    def take(self, channel: int, reading: int, now: int) -> None:
        """Takes a reading that came by `now` (ns)."""
        for i, (name, entry) in enumerate(self._inputs):
            if self.channels[i] != channel:
                continue
            value = entry.gain * reading / FULL + entry.offset
            if reading > FULL or not entry.lower <= value <= entry.upper:
                self.problem = f"analog[{name}] {value:.4g} isn't between {entry.lower:g} and {entry.upper:g}"
            else:
                self.values[i], self._heard[i] = value, now
