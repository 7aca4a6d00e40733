"""The RFT's CAN protocol: commands of one frame, responses of two (sheet robotous_rft_can, 1 to 3). No I/O."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

BITRATE: Final = 1_000_000  # fixed
RECEIVER: Final = 0x64
RESPONSES: Final = (0x01, 0x02)
FRAME: Final = 8  # bytes of each
AXES: Final = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
CUTOFFS: Final = (0, 500, 300, 200, 150, 100, 50, 40, 30, 20, 10, 5, 3, 2, 1)
"""Low-pass cutoff (Hz) by the filter's parameter; 0: none. The manual's table; an older header reverses it."""
RATES: Final = (200, 10, 20, 50, 100, 200, 333, 500, 1000)
"""Output rate (Hz) by its code; 0 is the default's."""
ERRORS: Final = {1: "unsupported command", 2: "value out of range", 3: "its memory can't be written"}
DIVISORS: Final = {  # counts per N, and per N m
    "RFT40-SA01": (50, 2000), "RFT44-SB01": (50, 2000), "RFT60-HA01": (50, 2000), "RFT64-SB01": (50, 2000),
    "RFT76-HA01": (50, 2000), "RFT82-HA02": (50, 1000), "RFT80-6A01": (50, 1000),
}  # fmt: skip
_RECORD: Final = struct.Struct(">B6hB2x")


class Command(IntEnum):
    """First byte of a command; its response repeats it."""

    MODEL = 0x01
    SERIAL = 0x02
    FIRMWARE = 0x03
    SET_IDS = 0x04
    READ_IDS = 0x05
    SET_FILTER = 0x08
    READ_FILTER = 0x09
    READ_ONCE = 0x0A
    START = 0x0B
    STOP = 0x0C  # no response
    SET_RATE = 0x0F
    READ_RATE = 0x10
    BIAS = 0x11  # no response
    OVERLOADS = 0x12


class Record(NamedTuple):
    """One sample.

    Attributes:
        counts: Fx, Fy, Fz, Tx, Ty, Tz, in counts.
        overload: bit 5 for Fx down to bit 0 for Tz, above 120 % of the rated load.
        polled: the answer to one READ_ONCE, not a record of the stream.
    """

    counts: tuple[int, int, int, int, int, int]
    overload: int = 0
    polled: bool = False

    @property
    def overloaded(self) -> tuple[str, ...]:
        """The names of the overloaded axes."""
        return tuple(axis for i, axis in enumerate(AXES) if self.overload >> 5 - i & 1)


class Response(NamedTuple):
    """The response to any other command.

    Attributes:
        command: the command's byte.
        values: the 15 bytes after it.
    """

    command: int
    values: bytes

    @property
    def text(self) -> str:
        """The text of the responses to MODEL, SERIAL, FIRMWARE."""
        return self.values.split(b"\0")[0].decode("ascii", "replace").strip()


def command(code: int, *parameters: int) -> bytes:
    """Returns a command's frame."""
    return bytes((code, *parameters)).ljust(FRAME, b"\0")


def response(code: int, values: bytes = b"") -> tuple[bytes, bytes]:
    """Returns the two frames of a response, as the sensor sends them."""
    whole = (bytes((code,)) + values[:15]).ljust(2 * FRAME, b"\0")
    return whole[:FRAME], whole[FRAME:]


def record(value: Record) -> tuple[bytes, bytes]:
    """Returns the two frames of a record, as the sensor sends them."""
    whole = _RECORD.pack(Command.READ_ONCE if value.polled else Command.START, *value.counts, value.overload)
    return whole[:FRAME], whole[FRAME:]


class Parser:
    """Pairs the frames of responses; frames with other ids are ignored.

    It drops a second half without a first, and a first half followed by another first half (4).

    Attributes:
        frames: pairs. errors: halves dropped and frames of a wrong length. resyncs: first halves replaced.
    """

    def __init__(self, first: int = RESPONSES[0], second: int = RESPONSES[1]) -> None:
        self.first, self.second = first, second
        self.frames = self.errors = self.resyncs = 0
        self._half: bytes | None = None

    def reset(self) -> None:
        """Forgets a first half that waits for its second."""
        self._half = None

    def feed(self, can_id: int, data: bytes) -> list[Record | Response]:
        """Returns what this frame completes: nothing or one message."""
        if can_id not in (self.first, self.second):
            return []
        if len(data) != FRAME:
            self.errors += 1
            self._half = None
            return []
        if can_id == self.first:
            if self._half is not None:
                self.errors += 1
                self.resyncs += 1
            self._half = bytes(data)
            return []
        half, self._half = self._half, None
        if half is None:
            self.errors += 1
            return []
        self.frames += 1
        code = half[0]
        if code in (Command.READ_ONCE, Command.START):
            _, *counts, overload = _RECORD.unpack(half + data)
            return [Record(tuple(counts), overload & 0x3F, code == Command.READ_ONCE)]
        return [Response(code, half[1:] + bytes(data))]
