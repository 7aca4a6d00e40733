"""Faults that keep servos from moving, in words and by motor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from srl.drivers.servo_bus.config import AxisConfig

LOST_TORQUE: Final = "lost its torque (its power dipped, or another program switched it off)"
FAR: Final = "is too far from its first command"
BEYOND: Final = "is beyond its servo's own position limits; bring it back by hand"


class Faults:
    """The faults that are present.

    Attributes:
        errors: hardware errors in words, by motor.
        limp: motors that have lost their torque.
        far: why motors couldn't follow their first command, in words, by motor.
        tripped: motors that their watchdog has stopped.
        stubborn: motors that didn't come back from a reboot.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self.clear()

    def clear(self) -> None:
        """Removes all faults."""
        self.errors: dict[int, str] = {}
        self.limp: set[int] = set()
        self.far: dict[int, str] = {}
        self.tripped: set[int] = set()
        self.stubborn: set[int] = set()

    def concerns(self, i: int) -> bool:
        """Returns whether motor `i` must stay without torque."""
        return i in self.errors or i in self.limp or i in self.far or i in self.stubborn

    def text(self) -> str:
        """Returns all faults as text for the user; "" if there is none."""
        parts = [f"{self._names[i]}: {what}" for i, what in sorted(self.errors.items())]
        parts += [f"{self._names[i]} {LOST_TORQUE}" for i in sorted(self.limp - self.errors.keys())]
        parts += [f"{self._names[i]} {what}" for i, what in sorted(self.far.items())]
        parts += [f"{self._names[i]} doesn't come back from its reboot" for i in sorted(self.stubborn)]
        if self.tripped:
            names = ", ".join(self._names[i] for i in sorted(self.tripped))
            parts.append(f"the bus watchdog has stopped {names}: nothing was sent for too long")
        return "; ".join(parts)


def who_is_silent(axes: Mapping[str, AxisConfig], ids: set[int]) -> str:
    """Returns the problem's text if servos haven't answered for a second."""
    if len(ids) == len(axes):
        return "no servo has answered for a second"
    name, id = next((name, motor.id) for name, motor in axes.items() if motor.id in ids)
    return f"'{name}' (id {id}) hasn't answered for a second, others have"
