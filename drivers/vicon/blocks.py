"""Bodies of the DataStream's blocks (sheet vicon_datastream, A.4), in the wire's units: mm, mm, rad, s. No I/O.

Every function accepts a body of any bytes. If the body is too short, it raises `MalformedError`, and nothing else.
Bytes after the known fields are skipped. Elements may have grown: their stride comes from the body's length.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final, NamedTuple

from srl.drivers.capture.names import Marker, Point, Segment, Subject

_U32: Final = struct.Struct("<I")
_TWO: Final = struct.Struct("<II")
_I64: Final = struct.Struct("<q")
_F64: Final = struct.Struct("<d")
_BOUNDS: Final = struct.Struct("<II6f")
_POSE: Final = struct.Struct("<12d")
_POINT: Final = struct.Struct("<3d")

SEGMENT: Final = 100  # bytes of u32 segment, f64 t[3], f64 R[9]
LABELED: Final = 116  # bytes of u32 subject, u32 marker, f64 radius, f64 position[3], f64 covariance[9], u32
UNLABELED: Final = 108  # the same without subject and marker


class MalformedError(ValueError):
    """A body is shorter than its fields."""


class Contents(NamedTuple):
    """A packet's contents: number of blocks by type, and the types that haven't changed and aren't sent."""

    counts: dict[int, int]
    unchanged: frozenset[int]


class _Cursor:
    """Reads fields one after another."""

    def __init__(self, body: memoryview | bytes) -> None:
        self._body = body
        self._at = 0

    def take(self, form: struct.Struct) -> tuple[float, ...]:
        try:
            values = form.unpack_from(self._body, self._at)
        except struct.error:
            raise MalformedError(f"{len(self._body)} bytes are too few") from None
        self._at += form.size
        return values

    def whole(self, form: struct.Struct = _U32) -> int:
        return int(self.take(form)[0])

    def text(self) -> str:
        size = self.whole()
        raw = bytes(self._body[self._at : self._at + size])
        if len(raw) < size:
            raise MalformedError(f"{len(self._body)} bytes are too few")
        self._at += size
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:  # the charset isn't defined (A.1)
            return raw.decode("latin-1")


def enums(body: memoryview | bytes) -> frozenset[int]:
    """Decodes ObjectEnums: types of blocks."""
    cursor = _Cursor(body)
    return frozenset(cursor.whole() for _ in range(cursor.whole()))


def contents(body: memoryview | bytes) -> Contents:
    """Decodes Contents."""
    cursor = _Cursor(body)
    counts = {cursor.whole(): cursor.whole() for _ in range(cursor.whole())}
    return Contents(counts, frozenset(cursor.whole() for _ in range(cursor.whole())))


def whole(body: memoryview | bytes) -> int:
    """Decodes the u32 of FrameInfo, RequestNextFrame and HardwareFrameInfo."""
    return _Cursor(body).whole()


def frame_period(body: memoryview | bytes) -> int:
    """Decodes StreamInfo: ticks of CLOCK per frame; 0 if unknown."""
    return _Cursor(body).whole(_I64)


def y_up(body: memoryview | bytes) -> bool:
    """Decodes ApplicationInfo: True if the server's y axis points up, False if its z axis does."""
    if not len(body):
        raise MalformedError("an empty body")
    return body[0] == 1


def latency(body: memoryview | bytes) -> float:
    """Decodes LatencyInfo: s, the sum of all its stages."""
    cursor = _Cursor(body)
    total = 0.0
    for _ in range(cursor.whole()):
        cursor.text()
        total += cursor.take(_F64)[0]
    return total


def subject_info(body: memoryview | bytes) -> Subject:
    """Decodes SubjectInfo."""
    cursor = _Cursor(body)
    number, name = cursor.whole(), cursor.text()
    segments = []
    for _ in range(cursor.whole()):
        parent, segment, *_ = cursor.take(_BOUNDS)
        segments.append(Segment(int(segment), cursor.text(), int(parent)))
    markers = tuple(Marker(cursor.whole(), cursor.text()) for _ in range(cursor.whole()))
    for _ in range(cursor.whole()):
        cursor.take(_TWO)  # which marker is on which segment; not needed, as the server does the fitting
    return Subject(number, name, tuple(segments), markers)


def segments_of(body: memoryview | bytes) -> int:
    """Decodes the subject's number of GlobalSegments."""
    return _Cursor(body).whole()


def find_segments(body: memoryview | bytes, rows: Mapping[int, int]) -> list[tuple[int, tuple[float, ...]]]:
    """Decodes the wanted segments of GlobalSegments or LocalSegments.

    Args:
        body: the block's body.
        rows: row by the segment's number.
    Returns:
        (row, (tx, ty, tz, R row by row)) each, mm; a missing segment is occluded.
    """
    if len(body) < 8:
        raise MalformedError("a body without its count")
    count = _TWO.unpack_from(body)[1]
    stride = _stride(len(body) - 8, count, SEGMENT)
    found = []
    for at in range(8, 8 + count * stride, stride or 1):
        row = rows.get(_U32.unpack_from(body, at)[0])
        if row is not None:
            found.append((row, _POSE.unpack_from(body, at + 4)))
    return found


def find_labeled(body: memoryview | bytes, rows: Mapping[tuple[int, int], int]) -> list[tuple[int, Point]]:
    """Decodes the wanted markers of LabeledRecons.

    Args:
        body: the block's body.
        rows: row by (subject's number, marker's number).
    Returns:
        (row, (x, y, z)) each, mm; a missing marker is occluded.
    """
    count = whole(body)
    stride = _stride(len(body) - 4, count, LABELED)
    found: list[tuple[int, Point]] = []
    for at in range(4, 4 + count * stride, stride or 1):
        row = rows.get(_TWO.unpack_from(body, at))
        if row is not None:
            found.append((row, _POINT.unpack_from(body, at + 16)))
    return found


def unlabeled(body: memoryview | bytes, most: int) -> list[Point]:
    """Decodes UnlabeledRecons: (x, y, z) of the first `most`, mm."""
    count = whole(body)
    stride = _stride(len(body) - 4, count, UNLABELED)
    return [_POINT.unpack_from(body, 4 + i * stride + 8) for i in range(min(count, most))]


def _stride(size: int, count: int, least: int) -> int:
    """Returns the bytes from element to element; a later version may have made elements longer (A.7)."""
    if count == 0:
        return 0
    if size // count < least:
        raise MalformedError(f"{count} elements don't fit into {size} bytes")
    return size // count
