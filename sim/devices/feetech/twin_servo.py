"""A simulated STS servo: its registers on top of its motor.

What is written below address 40 is kept over a power-off only while the lock is 0; it works at once either way.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.drivers.feetech.models import Model
from srl.drivers.feetech.table import END, SEVERAL_TURNS, TABLE, Word
from srl.drivers.feetech.units import CURRENT, VOLT
from srl.drivers.servo_bus.models import COUNTS, PER_COUNT
from srl.sim.parts.feetech.motors import GAIN, FeetechMotors
from srl.sim.parts.servo_bus.motors import EXTENDED, OVERLOAD_BIT, VELOCITY

CENTRE_HERE: Final = 128  # written to the torque enable: the present position becomes 2048
_ACCELERATION: Final = 100 * PER_COUNT  # rad/s^2 per unit
_SPEED_MODE: Final = 1
_BITS: Final = 0x2F


class Servo:
    """One servo.

    Attributes:
        now: ns of the twin's clock.
        memory: its registers. kept: those that survive a power-off.
        refused: how often a write was refused, by the register's name.
        wakes_on: whether its torque is on after power-up; reports differ.
    """

    def __init__(self, motors: FeetechMotors, i: int, model: Model, id: int, baud: int, several: bool) -> None:
        self.motors, self.i = motors, i
        self.mounted_for = 0
        self.now = 0
        self.refused: dict[str, int] = {}
        self.wakes_on = False
        self.memory = bytearray(END)
        for name, register in TABLE.items():
            self.put(name, register.default)
        found = {"model_number": model.number, "id": id, "baud_rate": baud, "firmware_major": 3, "firmware_minor": 10}
        if several:
            found |= {"phase": self.get("phase") | SEVERAL_TURNS, "min_position_limit": 0, "max_position_limit": 0}
        for name, value in found.items():
            self.put(name, value)
        self.kept = bytearray(self.memory)
        self.restart()

    def get(self, name: str) -> int:
        """The value of a register."""
        return TABLE[name].decode(self.memory)

    def put(self, name: str, value: int) -> None:
        """Sets a register as the firmware does."""
        register = TABLE[name]
        low, high = register.span
        self.memory[register.address : register.end] = register.encode(min(max(value, low), high))

    def keep(self, name: str, value: int) -> None:
        """Sets a register for good, as somebody with the vendor's tool does."""
        register = TABLE[name]
        self.put(name, value)
        self.kept[register.address : register.end] = register.encode(value)
        self.take_effect(name)

    @property
    def several_turns(self) -> bool:
        """Whether its position counts turns."""
        return bool(self.get("phase") & SEVERAL_TURNS)

    @property
    def position(self) -> int:
        """Its present position, counts, as it reports it."""
        counts = int(self.motors.counts[self.i]) + self.mounted_for - self.get("homing_offset")
        return counts if self.several_turns else counts % COUNTS

    @property
    def error_bits(self) -> int:
        """The error bits in each of its answers."""
        return int(self.motors.errors[self.i]) & _BITS

    def read(self, address: int, size: int) -> bytes:
        """Reads `size` bytes from `address` on; zeros behind the last register."""
        self.refresh()
        return bytes(self.memory[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """Writes from `address` on; read-only registers stay as they are."""
        end = address + len(data)
        for name, register in TABLE.items():
            if not (address <= register.address and register.end <= end):
                continue
            part = data[register.address - address : register.end - address]
            if not register.writable or not self._accepts(name, register, part):
                self.refused[name] = self.refused.get(name, 0) + 1
                continue
            self.memory[register.address : register.end] = part
            if register.eeprom and not self.get("lock"):
                self.kept[register.address : register.end] = part
            self.take_effect(name)

    def _accepts(self, name: str, register: Word, part: bytes) -> bool:
        if name == "operating_mode":
            return part[0] in (0, _SPEED_MODE)
        return name != "torque_enable" or part[0] in (0, 1, CENTRE_HERE)

    def take_effect(self, name: str) -> None:
        """Applies a register to the motor."""
        m, i, value = self.motors, self.i, self.get(name)
        match name:
            case "torque_enable" if value == CENTRE_HERE:
                self.put("homing_offset", int(m.counts[i]) + self.mounted_for - COUNTS // 2)
                self.kept[:] = self.memory
                self.put("torque_enable", int(m.torque[i]))
                self.put("goal_position", COUNTS // 2)
            case "torque_enable":
                self._aim()
                m.switch(i, bool(value))
                self._set_cap()
            case "goal_position":
                self._aim()
            case "goal_velocity" | "operating_mode":
                self._set_speed()
            case "acceleration":
                m.profile_acceleration[i] = value * _ACCELERATION
            case "torque_limit":
                self._set_cap()
            case "position_p_gain":
                m.kp[i] = GAIN * value
            case "temperature_limit":
                m.temperature_limit[i] = value

    def restart(self) -> None:
        """Powers up: what isn't kept is at its default, turns are forgotten."""
        self.memory[:] = self.kept
        for name, register in TABLE.items():
            if register.writable and not register.eeprom:
                self.put(name, register.default)
        self.put("torque_limit", self.get("max_torque"))
        m, i = self.motors, self.i
        m.power_up(i)
        self.put("goal_position", self.position)
        for name in ("position_p_gain", "temperature_limit", "torque_limit", "goal_velocity"):
            self.take_effect(name)
        if self.wakes_on:
            self.put("torque_enable", 1)
            self.take_effect("torque_enable")

    def instruction_taken(self) -> None:
        """Does nothing: the firmware doesn't watch the bus."""

    def tick(self) -> None:
        """Follows its own number of the position, which jumps at the end of its encoder."""
        self._aim()

    def refresh(self) -> None:
        """Writes the measured values into their registers."""
        m, i = self.motors, self.i
        self.put("torque_enable", int(m.torque[i]))
        self.put("present_position", self.position)
        self.put("present_velocity", _whole(m.velocity[i] / PER_COUNT))
        self.put("present_load", _whole(m.pwm[i] * 1000))
        self.put("present_voltage", _whole(m.voltage[i] / VOLT))
        self.put("present_temperature", _whole(m.temperature[i]))
        self.put("status", self.error_bits)
        self.put("moving", int(abs(m.velocity[i]) > 20 * PER_COUNT))
        self.put("present_current", _whole(m.current[i] / CURRENT))

    def _aim(self) -> None:
        goal, m, i = self.get("goal_position"), self.motors, self.i
        low, high = self.get("min_position_limit"), self.get("max_position_limit")
        if low < high:
            goal = min(max(goal, low), high)
        m.goal_position[i] = int(m.counts[i]) + goal - self.position

    def _set_speed(self) -> None:
        m, i, speed = self.motors, self.i, self.get("goal_velocity") * PER_COUNT
        turning = self.get("operating_mode") == _SPEED_MODE
        m.mode[i] = VELOCITY if turning else EXTENDED  # the motor is told a goal with its turns
        m.goal_velocity[i] = speed if turning else 0.0
        m.profile_velocity[i] = 0.0 if turning else abs(speed)

    def _set_cap(self) -> None:
        m, i = self.motors, self.i
        if not int(m.errors[i]) & OVERLOAD_BIT:
            m.pwm_cap[i] = self.get("torque_limit") / 1000


def _whole(value: float) -> int:
    return int(np.rint(value))
