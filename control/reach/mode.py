"""What a law that goes to goals says of itself."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """What the output `state` says."""

    NO_GOAL = 0
    ARRIVED = 1
    DIRECT = 2
    AROUND = 3
    LEAVING = 4
    WAITING = 5
    SEARCHING = 6
    UNREACHABLE = 7
    GIVING_WAY = 8
