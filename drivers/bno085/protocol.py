"""The BNO085's UART-RVC frames (BNO08X datasheet 1000-3927 v1.17, section 1.2.5.2). No I/O."""

from __future__ import annotations

from struct import Struct
from typing import Final, NamedTuple

BAUDRATE: Final = 115200
RATE: Final = 100.0  # Hz, nominal
WRAP: Final = 256  # of the index
SIZE: Final = 19  # bytes of a frame

_HEAD: Final = b"\xaa\xaa"
_BODY: Final = Struct("<B6h3x")  # index; yaw, pitch, roll; x, y, z; three bytes that a BNO086 fills
_CIRCLE: Final = 18000  # 0.01 degree
_QUARTER: Final = 9000


class Record(NamedTuple):
    """One frame, in the device's own units.

    Attributes:
        number: the index, 0..255; it grows by one a frame.
        yaw, pitch, roll: 0.01 degree; +-180, +-90, +-180 degrees.
        x, y, z: the specific force along the sensor's axes, 0.001 g.
    """

    number: int
    yaw: int
    pitch: int
    roll: int
    x: int
    y: int
    z: int


def encode(record: Record) -> bytes:
    """The frame of a record."""
    body = _BODY.pack(*record)
    return _HEAD + body + bytes((sum(body) % 256,))


class Parser:
    """Finds the frames in a stream of bytes; the result doesn't depend on how the stream was split.

    The header may also occur within a frame. So a place where it stands counts only if the checksum and the ranges of
    the angles fit, too; otherwise the search goes on at the next byte.

    Attributes:
        frames: good frames. errors: headers without a good frame behind them. resyncs: number of times the next frame
            didn't follow the last one at once, such as after the text that the sensor sends when it starts.
    """

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = 0
        self._buffer = bytearray()
        self._lost = False

    def feed(self, data: bytes) -> list[Record]:
        """Returns the records that `data` completes, in order. Keeps less than a frame's bytes."""
        buffer = self._buffer
        buffer += data
        found: list[Record] = []
        at = 0
        while len(buffer) - at >= SIZE:
            if not buffer.startswith(_HEAD, at):
                at = self._search(at)
                continue
            record = _decoded(buffer[at + 2 : at + SIZE])
            if record is None:
                self.errors += 1
                at = self._search(at + 1)
                continue
            self._lost = False
            self.frames += 1
            found.append(record)
            at += SIZE
        del buffer[:at]
        return found

    def _search(self, at: int) -> int:
        """Returns where the next frame may begin."""
        self.resyncs += not self._lost
        self._lost = True
        next_head = self._buffer.find(_HEAD, at)
        if next_head >= 0:
            return next_head
        return len(self._buffer) - self._buffer.endswith(_HEAD[:1])


def _decoded(body: bytes | bytearray) -> Record | None:
    """The record of a frame's bytes behind its header; None if checksum or ranges are wrong."""
    if sum(body[:-1]) % 256 != body[-1]:
        return None
    record = Record(*_BODY.unpack_from(body))
    fits = abs(record.yaw) <= _CIRCLE and abs(record.pitch) <= _QUARTER and abs(record.roll) <= _CIRCLE
    return record if fits else None
