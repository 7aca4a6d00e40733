"""Protocol 2.0 on the wire: instruction packets, and the parser of the answers. No I/O.

Source: protocol sheet dynamixel, §2. A packet is FF FF FD 00, id, length (u16, of the rest of the packet),
instruction, parameters, CRC-16; all numbers have the low byte first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from srl.drivers.servo_bus.packets import BROADCAST, Instruction, PacketParser, Status

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x10
STATUS, SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x55, 0x82, 0x83, 0x8A
BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A
PING_SIZE: Final = 3  # bytes of data in a ping's answer: model (u16), firmware
OVERHEAD: Final = 11  # bytes of a status around its data

# Low bits of a status' error byte.
OK, RESULT, INSTRUCTION, CRC, RANGE, LENGTH, LIMIT, ACCESS = range(8)
ALERT: Final = 0x80
ERRORS: Final = {
    RESULT: "it failed to process the instruction",
    INSTRUCTION: "it doesn't know the instruction",
    CRC: "the packet came to it damaged",
    RANGE: "the value is out of range",
    LENGTH: "the data is too short",
    LIMIT: "the value is beyond a limit of its own",
    ACCESS: "it can't be accessed now (read-only, or locked while its torque is on)",
}

LONGEST: Final = 1024  # greatest accepted LEN of a packet; a servo's buffer is smaller
_HEADER: Final = b"\xff\xff\xfd"


def _crc_table() -> tuple[int, ...]:
    rows = []
    for value in range(256):
        crc = value << 8
        for _ in range(8):
            crc = crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1
        rows.append(crc & 0xFFFF)
    return tuple(rows)


_CRC: Final = _crc_table()


def crc16(data: Iterable[int], crc: int = 0) -> int:
    """CRC-16, polynomial 0x8005, initial 0, not reflected; continues from `crc`."""
    table = _CRC
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ table[crc >> 8 ^ byte]
    return crc


def packet(id: int, code: int, data: bytes = b"") -> bytes:
    """Returns one whole packet, stuffed."""
    body = bytes((code,)) + data
    if _HEADER in body:
        body = body.replace(_HEADER, b"\xff\xff\xfd\xfd")
    length = len(body) + 2
    head = b"\xff\xff\xfd\x00" + bytes((id, length & 0xFF, length >> 8)) + body
    return head + crc16(head).to_bytes(2, "little")


def ping(id: int) -> bytes:
    """Pings one servo, or all of them."""
    return packet(id, PING)


def read(id: int, address: int, size: int) -> bytes:
    """Requests `size` bytes from `address` on."""
    return packet(id, READ, _u16(address) + _u16(size))


def write(id: int, address: int, data: bytes) -> bytes:
    """Writes from `address` on; acknowledged."""
    return packet(id, WRITE, _u16(address) + data)


def reboot(id: int) -> bytes:
    """Restarts a servo: torque off, volatile registers at their defaults, hardware errors cleared."""
    return packet(id, REBOOT)


def group_read(address: int, size: int, ids: Sequence[int]) -> bytes:
    """Sync read: each of the servos answers with `size` bytes from `address` on, in the order of `ids`."""
    return packet(BROADCAST, SYNC_READ, _u16(address) + _u16(size) + bytes(ids))


def fast_sync_read(address: int, size: int, ids: Sequence[int]) -> bytes:
    """Like `group_read`, but answered by one common status. MX servos don't know it (sheet, §2)."""
    return packet(BROADCAST, FAST_SYNC_READ, _u16(address) + _u16(size) + bytes(ids))


def sync_write(address: int, size: int, values: Mapping[int, bytes]) -> bytes:
    """Writes `size` bytes from `address` on, different ones for each servo; not acknowledged."""
    body = b"".join(bytes((id,)) + data for id, data in values.items())
    return packet(BROADCAST, SYNC_WRITE, _u16(address) + _u16(size) + body)


def status(id: int, error: int = 0, data: bytes = b"") -> bytes:
    """A servo's answer."""
    return packet(id, STATUS, bytes((error,)) + data)


def fast_status(parts: Sequence[tuple[int, int, bytes]]) -> bytes:
    """Returns the common answer to a fast sync read, from (id, error, data) of each servo; never stuffed."""
    length = 1 + sum(4 + len(data) for _, _, data in parts)
    out = bytearray(b"\xff\xff\xfd\x00\xfe" + _u16(length) + bytes((STATUS,)))
    crc, done = 0, 0
    for id, error, data in parts:
        out += bytes((error, id)) + data
        crc = crc16(out[done:], crc)
        done = len(out)
        out += crc.to_bytes(2, "little")
    return bytes(out)


def split_fast(common: Status, size: int) -> list[Status]:
    """Splits a fast sync read's common answer into the servos' parts; [] if the sizes don't fit.

    Args:
        common: from `Parser`, id 254; its checksum is that of the last part, which covers everything before it.
        size: bytes requested from each servo.
    """
    body = bytes((common.error | ALERT * common.alert,)) + common.data + b"\0\0"  # the last CRC is already removed
    if len(body) % (size + 4):
        return []
    parts = []
    for at in range(0, len(body), size + 4):
        error, id = body[at], body[at + 1]
        parts.append(Status(id, error & 0x7F, bool(error & ALERT), body[at + 2 : at + 2 + size]))
    return parts


class Parser(PacketParser):
    """See `PacketParser`. Packets of the other direction are skipped without a count.

    For the host an adapter's echo of the host's own bytes is such, for a servo other servos' answers.
    """

    header = _HEADER

    def __init__(self, longest: int = LONGEST) -> None:
        """`longest`: greatest LEN of a packet."""
        super().__init__()
        self._longest = longest

    def statuses(self, data: bytes) -> list[Status]:
        """Takes any bytes and returns the statuses they complete, oldest first. Never raises."""
        found = []
        for id, body in self._packets(data):
            if body[0] == STATUS and len(body) > 1:
                found.append(Status(id, body[1] & 0x7F, body[1] > 0x7F, body[2:]))
        return found

    def instructions(self, data: bytes) -> list[Instruction]:
        """Takes any bytes and returns the instructions they complete, oldest first. Never raises."""
        return [Instruction(id, body[0], body[1:]) for id, body in self._packets(data) if body[0] != STATUS]

    def _end(self, buffer: bytearray, start: int) -> int | None:
        head = buffer[start + 3 : start + 5]  # the reserved byte and the id, as far as they have arrived
        if (head and head[0]) or (len(head) > 1 and (head[1] > BROADCAST or head[1] == 0xFD)):
            return 0
        if len(buffer) < start + 7:
            return None
        length = buffer[start + 5] | buffer[start + 6] << 8
        return start + 7 + length if 3 <= length <= self._longest else 0

    def _packet(self, buffer: bytearray, start: int, end: int) -> tuple[int, bytes] | None:
        if crc16(memoryview(buffer)[start : end - 2]) != buffer[end - 2] | buffer[end - 1] << 8:
            return None
        id, body = buffer[start + 4], bytes(buffer[start + 7 : end - 2])
        if b"\xff\xff\xfd\xfd" in body and not (id == BROADCAST and body[0] == STATUS):
            body = body.replace(b"\xff\xff\xfd\xfd", _HEADER)
        return id, body


def _u16(value: int) -> bytes:
    return value.to_bytes(2, "little")
