"""Feetech's packets: byte for byte those of Dynamixel protocol 1, with a sync read and other error bits. No I/O.

Source: protocol sheet can_actuators, section 5. A ping's answer tells no model number.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Final

from srl.drivers.servo_bus.packets import BROADCAST
from srl.drivers.servo_bus.protocol1 import (
    ACTION,
    OVERHEAD,
    PING,
    PING_SIZE,
    READ,
    REG_WRITE,
    SYNC_WRITE,
    WRITE,
    Parser,
    packet,
    ping,
    read,
    status,
    sync_write,
    write,
)

SYNC_READ: Final = 0x82  # STS and SMS only; an SCS is silent
RESET: Final = 0x06

# Bits of a status' error byte, and of the register `status`.
VOLTAGE, SENSOR, HEAT, CURRENT, OVERLOAD = 1, 2, 4, 8, 32

_FILLERS: Final = range(0x7E, 0x1F, -1)  # no instruction among them
LONGEST: Final = 0x7E + 4  # bytes of a packet whose length is itself a filler byte

__all__ = [
    "ACTION", "BROADCAST", "OVERHEAD", "PING", "PING_SIZE", "READ", "REG_WRITE", "SYNC_READ", "SYNC_WRITE", "WRITE",
    "Parser", "filler", "group_read", "packet", "ping", "read", "reg_write", "status", "sync_write", "write",
]  # fmt: skip


def group_read(address: int, size: int, ids: Sequence[int]) -> bytes:
    """Sync read: each of the servos answers with `size` bytes from `address` on, in the order of `ids`."""
    return packet(BROADCAST, SYNC_READ, bytes((address, size, *ids)))


def reg_write(id: int, address: int, data: bytes) -> bytes:
    """Writes from `address` on when an ACTION comes."""
    return packet(id, REG_WRITE, bytes((address,)) + data)


def filler(ids: Sequence[int], frame: bytes = b"") -> bytes:
    """Returns bytes that complete a packet that was cut short anywhere, so that no servo obeys it.

    A servo clips a goal beyond its limits and goes there. So the filler must never make the sum of a cut packet right.

    Args:
        ids: the servos on the bus; the filler is no id of theirs.
        frame: the packet that may have been cut; b"" for none.
    """
    free = [byte for byte in _FILLERS if byte not in ids] or [_FILLERS[0]]
    sums = list(accumulate(frame[2:]))
    for byte in free:
        # `sums[k]` is the sum up to byte k + 2; the rest of the packet would be filler. A right sum ends in FF.
        if not any((total + byte * (len(sums) - 1 - k)) & 0xFF == 0xFF for k, total in enumerate(sums[:-1])):
            return bytes((byte,)) * LONGEST
    return bytes((free[0],)) * LONGEST
