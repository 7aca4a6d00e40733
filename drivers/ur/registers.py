"""The registers through which driver and control script talk: RTDE's upper, external half (24 to 47).

To the script: whose command it is, what to do, its number, for how long it holds, six values. From the script:
whom it obeys, how it is, the number of the newest command it took.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final

NONCE: Final = 24  # input and output int registers
MODE: Final = 25
SEQUENCE: Final = 26
PATIENCE: Final = 27  # control cycles that a command holds
VALUES: Final = 24  # first of six input double registers
STATE: Final = 25  # output int register

CYCLE: Final = 0.002  # s, of an e-Series controller
LAST: Final = 2**31 - 1  # a sequence number's greatest value; 1 comes next


class Mode(IntEnum):
    """What the script is to do."""

    STAY = 0  # come to rest and stay there
    FOLLOW = 1  # the six values
    END = 2  # come to rest and end the program


class ScriptState(IntEnum):
    """How the script is."""

    NONE = 0
    READY = 1  # at rest, waiting
    FOLLOWING = 2
    TIMED_OUT = 3  # ended: no command came for as long as the last one held
    ENDED = 4  # ended: it was told to
    ABANDONED = 5  # ended: another driver's commands, or none at all


INPUTS: Final = (
    *(f"input_int_register_{number}" for number in (NONCE, MODE, SEQUENCE, PATIENCE)),
    *(f"input_double_register_{VALUES + joint}" for joint in range(6)),
)
INPUT_TYPES: Final = ("INT32",) * 4 + ("DOUBLE",) * 6
OUTPUTS: Final = tuple(f"output_int_register_{number}" for number in (NONCE, STATE, SEQUENCE))
_COMMAND: Final = struct.Struct(">HBB4i6d")
SIZE: Final = _COMMAND.size


def command(
    recipe: int, nonce: int, mode: int, sequence: int, cycles: int, values: list[float] | tuple[float, ...]
) -> bytes:
    """One whole data message of `INPUTS`."""
    return _COMMAND.pack(SIZE, 85, recipe, nonce, mode, sequence, cycles, *values)
