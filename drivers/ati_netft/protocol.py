"""RDT, the sensor's UDP protocol: requests of 8 bytes, records of 36 (sheet ati_ft, 1.1, 1.2). No I/O."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

PORT: Final = 49152
HEADER: Final = 0x1234
_REQUEST: Final = struct.Struct(">HHI")
_RECORD: Final = struct.Struct(">III6i")
RECORD_SIZE: Final = _RECORD.size
MOST: Final = 1820  # records in the largest UDP datagram


class Request(IntEnum):
    """Commands of a request; each replaces the previous one."""

    STOP = 0x0000
    START = 0x0002  # one record per datagram
    START_BUFFERED = 0x0003  # several records per datagram
    RESET_LATCH = 0x0041
    BIAS = 0x0042


class Record(NamedTuple):
    """One sample.

    Attributes:
        sequence: number of the record within one stream request, from 1; wraps at 2**32.
        sample: the sensor's own sample counter, at its internal rate; wraps at 2**32.
        status: 32 bits, 0 for healthy; see `srl.drivers.ati_netft.status`.
        counts: Fx, Fy, Fz, Tx, Ty, Tz, in counts.
    """

    sequence: int
    sample: int
    status: int
    counts: tuple[int, int, int, int, int, int]


def request(command: int, count: int = 0) -> bytes:
    """Returns a request's bytes; `count`: records wanted, 0 for an endless stream."""
    return _REQUEST.pack(HEADER, command, count)


def parse_request(data: bytes) -> tuple[int, int] | None:
    """Returns (command, count) of a request, as the sensor reads it; None if it isn't one."""
    if len(data) != _REQUEST.size:
        return None
    header, command, count = _REQUEST.unpack(data)
    return (command, count) if header == HEADER else None


def record(value: Record) -> bytes:
    """Returns a record's bytes as the sensor sends them."""
    return _RECORD.pack(value.sequence, value.sample, value.status, *value.counts)


class Parser:
    """Parses datagrams. A datagram is whole or missing, so nothing is kept from one to the next.

    Attributes:
        frames: good records. errors: datagrams of a wrong size. resyncs: always 0, as there is nothing to search.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.errors = 0
        self.resyncs = 0

    def feed(self, datagram: bytes) -> list[Record]:
        """Returns the records of one datagram, oldest first; none if its size isn't a whole number of records."""
        count, rest = divmod(len(datagram), RECORD_SIZE)
        if rest or not 0 < count <= MOST:
            self.errors += 1
            return []
        self.frames += count
        return [Record(v[0], v[1], v[2], v[3:]) for v in _RECORD.iter_unpack(datagram)]
