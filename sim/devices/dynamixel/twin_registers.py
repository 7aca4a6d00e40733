"""The registers of one simulated servo: which values may be written, their effects, and what is read back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Final

import numpy as np

from srl.drivers.dynamixel.models import Model
from srl.drivers.dynamixel.table import POSITION, table
from srl.drivers.servo_bus.models import CENTRE
from srl.drivers.servo_bus.register import Register
from srl.sim.parts.dynamixel.motors import DynamixelMotors


class Registers(ABC):
    """One servo's control table on top of its motor. Errors are numbers of the servo's protocol; 0: no error.

    Attributes:
        model: the servo's model.
        protocol: the protocol of its firmware.
        by_name: its registers by name.
        motors: the chain's motors; `i` is the number of this one.
        now: ns of the twin's clock; the bus sets it before each access.
        refused: how often a write to each register was refused, by its name.
    """

    protocol: int
    access_error: int
    length_error: int
    range_error: int

    def __init__(self, motors: DynamixelMotors, i: int, model: Model, id: int, baud: int, firmware: int) -> None:
        self.motors, self.i, self.model = motors, i, model
        self.mounted_for = 0, False  # offset and reverse mode for which its horn is mounted: those of the profile
        self.by_name = table(model, self.protocol)
        self.size = max(register.end for register in self.by_name.values())
        self._at: list[Register | None] = [None] * self.size
        self._names = {register.address: name for name, register in self.by_name.items()}
        for register in self.by_name.values():
            self._at[register.address] = register
        self.memory = bytearray(self.size)
        for name, register in self.by_name.items():
            self.put(name, register.default)
        self.put("model_number", model.number(self.protocol))
        self.put("firmware_version", firmware)
        self.put("id", id)
        self.put("baud_rate", baud)
        self.now = 0
        self.refused: dict[str, int] = {}

    @property
    def sign(self) -> int:
        """-1 in reverse mode, else 1. The motor itself keeps its direction."""
        mode = self.by_name.get("drive_mode")
        reverse = mode is not None and bool(mode.decode(self.memory) & REVERSE)
        return -1 if reverse != self.mounted_for[1] else 1

    def shown(self, counts: Any) -> Any:
        """The motor's counts as the registers show them.

        Reverse mode mirrors them about the middle of the turn: chosen, no public source says about what.
        """
        return self._mirrored(counts - self.mounted_for[0]) + self.homing

    def aimed(self, value: Any) -> Any:
        """The motor's counts for a register's value."""
        return self._mirrored(value - self.homing) + self.mounted_for[0]

    def _mirrored(self, counts: Any) -> Any:
        return 2 * CENTRE - counts if self.sign < 0 else counts

    @property
    def homing(self) -> int:
        """Counts that are added to the position; over one turn a servo ignores more than a quarter turn."""
        if "homing_offset" not in self.by_name:
            return 0
        value = self.get("homing_offset")
        return 0 if self.get("operating_mode") == POSITION and abs(value) > 1024 else value

    def get(self, name: str) -> int:
        """The value of a register."""
        return self.by_name[name].decode(self.memory)

    def put(self, name: str, value: int) -> None:
        """Sets a register as the firmware does; the value is clipped to the register's size."""
        register = self.by_name[name]
        bits = 8 * register.size
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if register.signed else (0, (1 << bits) - 1)
        self.memory[register.address : register.end] = register.encode(int(min(max(value, low), high)))

    def read(self, address: int, size: int) -> tuple[int, bytes]:
        """Reads `size` bytes from `address` on; returns the error and the bytes."""
        if size <= 0 or address + size > self.size:
            return self.access_error, b""
        self.refresh()
        return 0, bytes(self.memory[address : address + size])

    def write(self, address: int, data: bytes, volatile_only: bool = False) -> int:
        """Writes whole registers from `address` on, all or none; returns the error."""
        if not data:
            return self.length_error
        locked = volatile_only or bool(self.motors.torque[self.i])
        changes: list[tuple[str, int]] = []
        at = 0
        while at < len(data):
            place = address + at
            register = self._at[place] if place < self.size else None
            if register is None or not register.writable:
                return self.access_error
            if register.eeprom and locked:
                name = self._names[register.address]
                self.refused[name] = self.refused.get(name, 0) + 1
                return self.access_error
            if at + register.size > len(data):
                return self.length_error
            value = register.decode(data[at:], place)
            name = self._names[register.address]
            low = register.low if register.low is not None else value
            high = register.high if register.high is not None else value
            error = self.range_error if not low <= value <= high else self.refuses(name, value)
            if error:
                self.refused[name] = self.refused.get(name, 0) + 1
                return error
            changes.append((name, value))
            at += register.size
        for name, value in changes:
            self.put(name, value)
            self.take_effect(name, value)
        return 0

    def factory_reset(self, keep: tuple[str, ...]) -> None:
        """Sets all registers to their state on delivery, except those to keep; `restart` must follow."""
        kept = {name: self.get(name) for name in (*keep, "model_number", "firmware_version")}
        for name, register in self.by_name.items():
            self.put(name, kept.get(name, register.default))

    @abstractmethod
    def refresh(self) -> None:
        """Writes the measured values into their registers."""

    @abstractmethod
    def refuses(self, name: str, value: int) -> int:
        """The error with which a value within its register's range is refused; 0 if it is accepted."""

    @abstractmethod
    def take_effect(self, name: str, value: int) -> None:
        """Applies a new register value to the motor."""

    @abstractmethod
    def restart(self) -> None:
        """Powers up: volatile registers at their defaults, the motor limp."""

    @abstractmethod
    def instruction_taken(self) -> None:
        """Called when any instruction arrives on the bus."""

    @abstractmethod
    def tick(self) -> None:
        """Called as time passes; checks whether the watchdog has run out."""

    def _volatile_defaults(self) -> None:
        for name, register in self.by_name.items():
            if not register.eeprom and register.writable:
                self.put(name, register.default)


def whole(value: float) -> int:
    """The nearest integer."""
    return int(np.rint(value))


REVERSE: Final = 1  # bit of the drive mode
RPM: Final = 2 * np.pi / 60  # rad/s
