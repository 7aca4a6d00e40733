"""What keeps the servos of a Feetech bus from moving, in words and by motor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.drivers.feetech import protocol
from srl.drivers.servo_bus.faults import Faults
from srl.runtime.contracts.signals import Array

WORDS: Final = {
    protocol.VOLTAGE: "input voltage out of its limits",
    protocol.SENSOR: "angle sensor",
    protocol.HEAT: "overheating",
    protocol.CURRENT: "over-current",
    protocol.OVERLOAD: "overload: it now pushes with its protective torque only",
}
NEAR: Final = 5.0  # K below a servo's own limit at which a person is told
LONG: Final = 300_000_000  # ns beyond a limit before it is a fault; a start pulls the supply down for less


def bits_in_words(bits: int) -> str:
    """Returns a servo's error bits in words; "" for none."""
    named = [text for bit, text in WORDS.items() if bits & bit]
    if rest := bits & ~sum(WORDS):
        named.append(f"error {rest:#04x}")
    return ", ".join(named)


class FeetechFaults(Faults):
    """The faults of a Feetech bus.

    Attributes:
        turned: motors whose position jumped by whole turns, and by how many.
        beyond: temperature or voltage out of the servo's own limits, in words, by motor.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.turned: dict[int, int] = {}
        self.beyond: dict[int, str] = {}
        super().__init__(names)

    def clear(self) -> None:
        super().clear()
        self.turned.clear()
        self.beyond.clear()

    def concerns(self, i: int) -> bool:
        return super().concerns(i) or i in self.turned or i in self.beyond

    def bits(self, i: int, bits: int) -> None:
        """Takes a motor's error bits. What was seen once stays until `clear`."""
        if bits:
            self.errors[i] = bits_in_words(bits)

    def text(self) -> str:
        parts = [text] if (text := super().text()) else []
        parts += [
            f"{self._names[i]}: its position jumped by {turns:+d} turn{'s' * (abs(turns) > 1)} (its power dipped, or "
            "its encoder passed its end); its torque was switched off"
            for i, turns in sorted(self.turned.items())
        ]
        parts += [f"{self._names[i]} {what}" for i, what in sorted(self.beyond.items())]
        return "; ".join(parts)


class Watch:
    """Watches temperatures and voltages against the servos' own limits.

    A servo's own protection can be off (its unload conditions), so the driver doesn't wait for its error bit.
    """

    def __init__(
        self, names: tuple[str, ...], hottest: Sequence[float], voltages: Sequence[tuple[float, float]]
    ) -> None:
        self._names = names
        self._hottest = np.array(hottest)
        self._low, self._high = np.array(voltages).T
        self._since: dict[int, int] = {}  # ns, by motor: beyond a limit since then

    def forget(self) -> None:
        """Begins to count anew, after a reset."""
        self._since.clear()

    def judge(self, temperature: Array, voltage: Array, now: int, faults: FeetechFaults) -> str:
        """Adds to the faults what has been beyond a limit for some time; returns a warning, "" for none."""
        hot = temperature >= self._hottest
        out = (voltage < self._low) | (voltage > self._high)
        for i in list(self._since):
            if not (hot[i] or out[i]):
                del self._since[i]
        for i in map(int, np.flatnonzero(hot | out)):
            if now - self._since.setdefault(i, now) >= LONG:
                faults.beyond[i] = (
                    f"is at {temperature[i]:.0f} degC, its limit is {self._hottest[i]:.0f}"
                    if hot[i]
                    else f"has {voltage[i]:.1f} V, its limits are {self._low[i]:.1f} to {self._high[i]:.1f} V"
                )
        warm = np.flatnonzero(temperature >= self._hottest - NEAR)
        return ", ".join(
            f"{self._names[i]} is at {temperature[i]:.0f} degC (limit {self._hottest[i]:.0f})" for i in warm
        )
