"""The motor's switch."""

from __future__ import annotations

from enum import Enum, auto


class Motor(Enum):
    """What the driver wants of the motor, and whether the hand has confirmed it."""

    OFF = auto()
    TURNING_ON = auto()
    ON = auto()
    TURNING_OFF = auto()
