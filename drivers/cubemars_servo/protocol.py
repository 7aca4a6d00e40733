"""The servo mode of CubeMars AK actuators, without I/O. Source: protocol sheet can_actuators, section 3.

Commands have the extended identifier mode * 256 + id, big-endian. Position is degrees of the output shaft, speed is
electrical rpm (output rpm times gear times pole pairs), current is A. There is no frame here that sets the origin:
mode 5 moves the zero under a running controller, and some firmware stores it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import can

STATUS: Final = 0x29  # bits 8 to 28 of the identifier of a status
MOST_DEGREES: Final = 3200.0  # what a status can say; beyond, some firmware stays and some wraps
_MOST_CURRENT: Final = 60.0  # A
_MOST_SPEED: Final = 100_000  # electrical rpm
_MOST_RAMP: Final = 327_670  # electrical rpm and rpm/s of a position with speed


class Mode(IntEnum):
    """What a host sends. Only the first five of them are ever sent from here."""

    CURRENT = 1
    BRAKE = 2
    SPEED = 3
    POSITION_SPEED = 6
    DUTY = 0
    POSITION = 4
    ORIGIN = 5
    MIT = 8


ERRORS: Final = {
    1: ("has a motor that is too hot", "let it cool; the limb may be too heavy for it"),
    2: ("drew too much current", "check for a short circuit and a blocked axis"),
    3: ("had too high a supply voltage", "a falling limb feeds back: check the supply"),
    4: ("had too low a supply voltage", "check supply and battery"),
    5: ("has a fault of its encoder", "switch it off and on; if it stays, ask the maker"),
    6: ("has a power stage that is too hot, or unbalanced phases", "let it cool, check the motor's wires"),
    7: ("is stalled", "free the axis"),
}


def identifier(mode: int, drive: int) -> int:
    """The extended identifier of a command."""
    return mode << 8 | drive


def split(identifier: int) -> tuple[int, int]:
    """What stands before the id, and the id."""
    return identifier >> 8, identifier & 0xFF


def _message(mode: Mode, drive: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=identifier(mode, drive), data=data, is_extended_id=True)


def current(drive: int, amperes: float) -> can.Message:
    """Iq; 0 lets the shaft go."""
    return _message(Mode.CURRENT, drive, struct.pack(">i", round(_within(amperes, _MOST_CURRENT) * 1000)))


def brake(drive: int, amperes: float) -> can.Message:
    """A current against the motion."""
    return _message(Mode.BRAKE, drive, struct.pack(">i", round(_within(abs(amperes), _MOST_CURRENT) * 1000)))


def speed(drive: int, erpm: float) -> can.Message:
    """Electrical rpm."""
    return _message(Mode.SPEED, drive, struct.pack(">i", round(_within(erpm, _MOST_SPEED))))


def position(drive: int, degrees: float, erpm: float, ramp: float) -> can.Message:
    """Degrees, with the most speed (electrical rpm) and acceleration (electrical rpm/s), both in steps of 10."""
    steps = [max(1, round(min(abs(x), _MOST_RAMP) / 10)) for x in (erpm, ramp)]
    place = round(_within(degrees, MOST_DEGREES) * 10_000)
    return _message(Mode.POSITION_SPEED, drive, struct.pack(">ihh", place, *steps))


@dataclass(frozen=True)
class Status:
    """degrees, electrical rpm, A, degC of the drive, error."""

    degrees: float
    erpm: float
    current: float
    temperature: int
    error: int


def status(data: bytes) -> Status | None:
    """Takes a status frame; None if it isn't one."""
    if len(data) != 8:
        return None
    place, velocity, iq, temperature, error = struct.unpack(">hhhbB", data)
    return Status(place / 10, velocity * 10.0, iq / 100, temperature, error)


def in_words(error: int) -> str:
    """An error in words, for behind the axis' name; "" for none."""
    if error == 0:
        return ""
    text, remedy = ERRORS.get(error, (f"has error {error}, which the maker's list doesn't name", "ask the maker"))
    return f"{text} ({remedy})"


def _within(value: float, most: float) -> float:
    return max(-most, min(most, value))
