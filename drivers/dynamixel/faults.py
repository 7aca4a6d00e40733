"""The hardware errors of the servos, in words and by motor (sheet dynamixel, §4)."""

from __future__ import annotations

from typing import Final

from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.faults import Faults

ERRORS2: Final = {
    0: "input voltage",
    2: "overheating",
    3: "encoder",
    4: "electrical shock",
    5: "overload",
}  # bits of the hardware error status (sheet, §4)
ERRORS1: Final = {0: "input voltage", 2: "overheating", 5: "overload"}
_SERIOUS1: Final = protocol1.HEAT | protocol1.OVERLOAD  # after these the torque limit falls to 0


class DynamixelFaults(Faults):
    """The faults of a Dynamixel bus."""

    def hardware(self, i: int, bits: int, protocol: int) -> None:
        """Takes a motor's error bits."""
        words = ERRORS2 if protocol == 2 else ERRORS1
        if protocol == 1 and not bits & _SERIOUS1:
            bits = 0
        named = [text for bit, text in words.items() if bits >> bit & 1]
        if bits and not named:
            named = [f"error {bits:#04x}"]
        if named:
            self.errors[i] = ", ".join(named)
