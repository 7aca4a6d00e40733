"""The registers of the STS series, and how their numbers are written (protocol sheet can_actuators, 5.2).

A signed number is a magnitude with a sign bit above it. It is checked before it is encoded: a number that is too large
would lose its sign, or turn into another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.drivers.servo_bus.register import Register


@dataclass(frozen=True, slots=True)
class Word(Register):
    """A register.

    Attributes:
        sign_bit: the number of its sign bit; None: it has no sign.
        big: the high byte is first, as in the SCS series.
    """

    sign_bit: int | None = None
    big: bool = False

    @property
    def span(self) -> tuple[int, int]:
        """The lowest and the highest number that fits."""
        if self.sign_bit is None:
            return 0, (1 << 8 * self.size) - 1
        most = (1 << self.sign_bit) - 1
        return -most, most

    def encode(self, value: int) -> bytes:
        """Encodes a number.

        Raises:
            ValueError: it doesn't fit.
        """
        low, high = self.span
        if not low <= value <= high:
            raise ValueError(f"{value} doesn't fit register {self.address}: {low} to {high}")
        raw = -value | 1 << self.sign_bit if self.sign_bit is not None and value < 0 else value
        return raw.to_bytes(self.size, "big" if self.big else "little")

    def decode(self, data: bytes | bytearray, base: int = 0) -> int:
        """Decodes the number from bytes that begin at address `base`."""
        at = self.address - base
        raw = int.from_bytes(data[at : at + self.size], "big" if self.big else "little")
        if self.sign_bit is None:
            return raw
        size = raw & (1 << self.sign_bit) - 1
        return -size if raw >> self.sign_bit & 1 else size


def signed(raw: NDArray[Any], sign_bit: int) -> NDArray[np.int64]:
    """Decodes many numbers at once."""
    size = (raw & ((1 << sign_bit) - 1)).astype(np.int64)
    return np.where(raw >> sign_bit & 1, -size, size)


def _e(address: int, size: int, default: int, sign_bit: int | None = None) -> Word:
    return Word(address, size, eeprom=True, default=default, sign_bit=sign_bit)


def _w(address: int, size: int, default: int = 0, sign_bit: int | None = None) -> Word:
    return Word(address, size, default=default, sign_bit=sign_bit)


def _r(address: int, size: int, sign_bit: int | None = None) -> Word:
    return Word(address, size, writable=False, sign_bit=sign_bit)


TABLE: Final[dict[str, Word]] = {
    "firmware_major": _r(0, 1),
    "firmware_minor": _r(1, 1),
    "model_number": _r(3, 2),
    "id": _e(5, 1, 1),
    "baud_rate": _e(6, 1, 0),
    "return_delay_time": _e(7, 1, 250),
    "status_return_level": _e(8, 1, 1),
    "min_position_limit": _e(9, 2, 0),
    "max_position_limit": _e(11, 2, 4095),
    "temperature_limit": _e(13, 1, 70),
    "max_voltage_limit": _e(14, 1, 140),
    "min_voltage_limit": _e(15, 1, 40),
    "max_torque": _e(16, 2, 1000),
    "phase": _e(18, 1, 12),
    "unload_conditions": _e(19, 1, 44),
    "position_p_gain": _e(21, 1, 32),
    "position_d_gain": _e(22, 1, 32),
    "position_i_gain": _e(23, 1, 0),
    "homing_offset": _e(31, 2, 0, sign_bit=11),
    "operating_mode": _e(33, 1, 0),
    "protective_torque": _e(34, 1, 20),
    "protection_time": _e(35, 1, 200),
    "overload_torque": _e(36, 1, 80),
    "torque_enable": _w(40, 1),
    "acceleration": _w(41, 1),
    "goal_position": _w(42, 2, sign_bit=15),
    "goal_time": _w(44, 2),
    "goal_velocity": _w(46, 2, sign_bit=15),
    "torque_limit": _w(48, 2, 1000),
    "lock": _w(55, 1, 1),
    "present_position": _r(56, 2, sign_bit=15),
    "present_velocity": _r(58, 2, sign_bit=15),
    "present_load": _r(60, 2, sign_bit=10),
    "present_voltage": _r(62, 1),
    "present_temperature": _r(63, 1),
    "status": _r(65, 1),
    "moving": _r(66, 1),
    "present_current": _r(69, 2, sign_bit=15),
    "max_acceleration": _e(85, 1, 254),
}
END: Final = 86  # the address after the last one

# In the SCS series words have the high byte first, and the lock stands where the torque limit is in the STS.
SCS_GOAL: Final = Word(42, 2, big=True)
SCS_LOCK: Final = Word(48, 1)

SEVERAL_TURNS: Final = 0x10  # bit of `phase`: the position counts turns
TURNS: Final = 7 * 4096  # counts in either direction that this driver commands over several turns
POSITION: Final = 0  # operating mode

# The codes with whose meaning all sources agree.
BAUDS: Final = (1_000_000, 500_000, 250_000, 128_000, 115_200)
