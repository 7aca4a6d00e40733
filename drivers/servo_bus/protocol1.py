"""Protocol 1.0 on the wire: instruction packets, and the parser of the answers. No I/O.

Source: protocol sheet dynamixel, §3. A packet is FF FF, id, length (of the rest of the packet), instruction or error
bits, parameters, checksum; all numbers have the low byte first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from srl.drivers.servo_bus.packets import BROADCAST, Instruction, PacketParser, Status

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
SYNC_WRITE, BULK_READ = 0x83, 0x92
PING_SIZE: Final = 0  # bytes of data in a ping's answer
OVERHEAD: Final = 6  # bytes of a status around its data

# Bits of a status' error byte.
VOLTAGE, ANGLE, HEAT, RANGE, CHECKSUM, OVERLOAD, INSTRUCTION = (1 << bit for bit in range(7))

_HEADER: Final = b"\xff\xff"


def packet(id: int, code: int, data: bytes = b"") -> bytes:
    """Returns one whole packet; `code` is the instruction, or a status's error bits."""
    body = bytes((id, len(data) + 2, code)) + data
    return _HEADER + body + bytes((~sum(body) & 0xFF,))


def ping(id: int) -> bytes:
    """Pings a servo."""
    return packet(id, PING)


def read(id: int, address: int, size: int) -> bytes:
    """Requests `size` bytes from `address` on."""
    return packet(id, READ, bytes((address, size)))


def write(id: int, address: int, data: bytes) -> bytes:
    """Writes from `address` on; acknowledged."""
    return packet(id, WRITE, bytes((address,)) + data)


def group_read(address: int, size: int, ids: Sequence[int]) -> bytes:
    """Bulk read: each of the servos answers with `size` bytes from `address` on, in the order of `ids`."""
    return packet(BROADCAST, BULK_READ, b"\0" + b"".join(bytes((size, id, address)) for id in ids))


def sync_write(address: int, size: int, values: Mapping[int, bytes]) -> bytes:
    """Writes `size` bytes from `address` on, different ones for each servo; not acknowledged."""
    body = b"".join(bytes((id,)) + data for id, data in values.items())
    return packet(BROADCAST, SYNC_WRITE, bytes((address, size)) + body)


def status(id: int, error: int = 0, data: bytes = b"") -> bytes:
    """A servo's answer."""
    return packet(id, error, data)


class Parser(PacketParser):
    """See `PacketParser`. Nothing in a packet shows its direction, so an adapter that echoes bytes can't be used."""

    header = _HEADER

    def statuses(self, data: bytes) -> list[Status]:
        """Takes any bytes and returns the statuses they complete, oldest first. Never raises."""
        return [Status(id, body[0], False, body[1:]) for id, body in self._packets(data)]

    def instructions(self, data: bytes) -> list[Instruction]:
        """Takes any bytes and returns the instructions they complete, oldest first. Never raises."""
        return [Instruction(id, body[0], body[1:]) for id, body in self._packets(data)]

    def _end(self, buffer: bytearray, start: int) -> int | None:
        if len(buffer) > start + 2 and buffer[start + 2] == 0xFF:  # one extra FF in front
            return 0
        if len(buffer) < start + 4:
            return None
        length = buffer[start + 3]
        return start + 4 + length if length >= 2 else 0

    def _packet(self, buffer: bytearray, start: int, end: int) -> tuple[int, bytes] | None:
        if sum(memoryview(buffer)[start + 2 : end]) & 0xFF != 0xFF:
            return None
        return buffer[start + 2], bytes(buffer[start + 4 : end - 1])
