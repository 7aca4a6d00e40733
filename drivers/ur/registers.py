"""The registers through which driver and control script talk: RTDE's upper, external half (24 to 47).

To the script: the driver's nonce, the mode, the command's number, the time for which it is valid, six values. From
the script: the nonce it obeys, its state, the number of the newest command it took.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final

NONCE: Final = 24  # input and output int registers
MODE: Final = 25
SEQUENCE: Final = 26
TIMEOUT: Final = 27  # control cycles for which a command is valid
VALUES: Final = 24  # first of six input double registers
STATE: Final = 25  # output int register

CYCLE: Final = 0.002  # s, of an e-Series controller
LAST: Final = 2**31 - 1  # greatest sequence number; 1 comes next


class Mode(IntEnum):
    """What the script shall do."""

    STAY = 0  # come to rest and stay there
    FOLLOW = 1  # the six values
    END = 2  # come to rest and end the program


class ScriptState(IntEnum):
    """The script's state."""

    NONE = 0
    READY = 1  # at rest, waiting
    FOLLOWING = 2
    TIMED_OUT = 3  # ended: no command came within the time for which the last one was valid
    ENDED = 4  # ended: on command
    ABANDONED = 5  # ended: commands came from another driver, or none came at all


INPUTS: Final = (
    *(f"input_int_register_{number}" for number in (NONCE, MODE, SEQUENCE, TIMEOUT)),
    *(f"input_double_register_{VALUES + joint}" for joint in range(6)),
)
INPUT_TYPES: Final = ("INT32",) * 4 + ("DOUBLE",) * 6
OUTPUTS: Final = tuple(f"output_int_register_{number}" for number in (NONCE, STATE, SEQUENCE))
_COMMAND: Final = struct.Struct(">HBB4i6d")
SIZE: Final = _COMMAND.size


def command(
    recipe: int, nonce: int, mode: int, sequence: int, cycles: int, values: list[float] | tuple[float, ...]
) -> bytes:
    """Returns one complete data message of `INPUTS`."""
    return _COMMAND.pack(SIZE, 85, recipe, nonce, mode, sequence, cycles, *values)
