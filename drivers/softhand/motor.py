"""The on/off states of the motor."""

from __future__ import annotations

from enum import Enum, auto


class Motor(Enum):
    """The motor state that the driver wants, and whether the hand has confirmed it."""

    OFF = auto()
    TURNING_ON = auto()
    ON = auto()
    TURNING_OFF = auto()
