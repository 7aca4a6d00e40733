"""A NatNet frame, 3.0 to 4.x (sheet optitrack_natnet, 5), in the wire's units and axes. No I/O.

From 4.1 each section says how many bytes it has. A version that isn't known (4.4 and later) is read likewise; what is
behind the known items of a section is left out.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from srl.drivers.capture.names import Point
from srl.drivers.natnet.protocol import Cursor, MalformedError, Version
from srl.runtime.contracts.rotation import Quaternion

BODY: Final = struct.Struct("<i3f4ffh")  # 38 bytes
MARKER: Final = struct.Struct("<i3ffhf")  # 26 bytes
POINT: Final = struct.Struct("<3f")
SUFFIX: Final = struct.Struct("<IIdQQQ")
PTP: Final = struct.Struct("<II")
TAIL: Final = struct.Struct("<hi")
_I32: Final = struct.Struct("<i")
KNOWN: Final = Version(4, 3)  # the newest whose layout is known
COUNTED: Final = Version(4, 1)  # sections with byte counts, assets, precision time stamp

TRACKED: Final = 0x01  # of a body
OCCLUDED: Final = 0x01  # of a marker
FILLED: Final = 0x04  # put where the model has it: not measured
UNLABELLED: Final = 0x10

RECORDING: Final = 0x01  # of a frame
MODEL_CHANGED: Final = 0x02
EDITED: Final = 0x04  # a take is shown, nothing is measured
STREAM_CHANGED: Final = 0x08


class Body(NamedTuple):
    """A rigid body or bone. `error`: m, the markers' mean."""

    id: int
    position: Point
    rotation: Quaternion  # w, x, y, z
    error: float
    tracked: bool


class Marker(NamedTuple):
    """A labelled marker; `owner` is its asset's number, `member` its own there, from 1. `size`, `residual`: m."""

    owner: int
    member: int
    position: Point
    size: float
    flags: int
    residual: float


@dataclass(slots=True)
class MotiveFrame:
    """One frame.

    Attributes:
        number: Motive's, which may begin anew.
        time: s, the frame clock.
        exposed, received, sent: ticks; `exposed` is 0 where the cameras don't say it.
        flags: see RECORDING and so on.
        bodies: rigid bodies. skeletons: bones by the skeleton's number. markers: labelled ones. others: unlabelled, m.
    """

    number: int
    time: float = 0.0
    exposed: int = 0
    received: int = 0
    sent: int = 0
    flags: int = 0
    bodies: list[Body] = field(default_factory=list)
    skeletons: dict[int, list[Body]] = field(default_factory=dict)
    markers: list[Marker] = field(default_factory=list)
    others: list[Point] = field(default_factory=list)


def number(payload: bytes) -> int:
    """The frame's number, without reading the rest."""
    if len(payload) < 4:
        raise MalformedError(f"a frame of {len(payload)} bytes")
    return int(_I32.unpack_from(payload)[0])


def decode(payload: bytes, version: Version) -> MotiveFrame:
    """Decodes a frame's payload.

    Args:
        payload: behind the header.
        version: the stream's, as the server info says it.
    Raises:
        MalformedError: the bytes aren't such a frame of this version.
    """
    c = Cursor(payload)
    frame = MotiveFrame(c.whole())
    counted = version >= COUNTED
    with_end = _Sections(c, counted)
    with_end.begin(5)
    for _ in range(with_end.count):
        c.text()
        c.skip(POINT.size * c.count(POINT.size))
    with_end.begin(POINT.size)
    frame.others = [_point(c.take(POINT)) for _ in range(with_end.count)]
    with_end.begin(BODY.size)
    frame.bodies = list(_bodies(c, with_end.count))
    with_end.begin(8)
    for _ in range(with_end.count):
        skeleton = c.whole()
        frame.skeletons[skeleton] = list(_bodies(c, c.count(BODY.size)))
    if counted:  # assets: trained marker sets; nothing here takes them
        with_end.begin(12)
        for _ in range(with_end.count):
            c.whole()
            c.skip(BODY.size * c.count(BODY.size))
            c.skip(MARKER.size * c.count(MARKER.size))
    with_end.begin(MARKER.size)
    frame.markers = [_marker(c.take(MARKER)) for _ in range(with_end.count)]
    for _ in range(2):  # force plates, devices
        with_end.begin(8)
        for _ in range(with_end.count):
            c.whole()
            for _ in range(c.count(4)):
                c.skip(4 * c.count(4))
    with_end.end()
    _, _, frame.time, frame.exposed, frame.received, frame.sent = c.take(SUFFIX)  # type: ignore[assignment]
    # The vendor's own sample reads the precision stamp of 4.0 frames, which have none: the bytes left decide.
    rest = c.left
    if rest >= PTP.size + TAIL.size:
        c.skip(PTP.size)
    flags, end = c.take(TAIL)
    if version <= KNOWN and (rest not in _rests(version) or end):
        raise MalformedError(f"{rest} bytes behind the stamps: it is another version's frame")
    frame.flags = int(flags)
    return frame


def _rests(version: Version) -> tuple[int, ...]:
    """The bytes that may be left behind the time stamps."""
    short, long = TAIL.size, PTP.size + TAIL.size
    if version >= COUNTED:
        return (long,)
    return (short, long) if version.major == 4 else (short,)


class _Sections:
    """Goes from section to section; from 4.1 on by the bytes that the section says it has."""

    def __init__(self, cursor: Cursor, counted: bool) -> None:
        self._cursor, self._counted = cursor, counted
        self._end: int | None = None
        self.count = 0

    def begin(self, least: int) -> None:
        """Ends a section and begins the next, of items of `least` bytes or more."""
        self.end()
        c = self._cursor
        count = c.whole()
        if self._counted:
            size = c.whole()
            # A count of 0 bytes is sent by some; the maker's own library doesn't use it.
            if not 0 <= size <= c.left:
                raise MalformedError(f"a section of {size} bytes, {c.left} are left")
            self._end = c.at + size if size else None
        if not 0 <= count * least <= c.left:
            raise MalformedError(f"{count} items don't fit into {c.left} bytes")
        self.count = count

    def end(self) -> None:
        """Leaves out what the section has behind its items."""
        if self._end is not None:
            self._cursor.skip(self._end - self._cursor.at)  # refuses a section that is shorter than its items
            self._end = None


def _bodies(c: Cursor, count: int) -> Iterator[Body]:
    for _ in range(count):
        number, x, y, z, qx, qy, qz, qw, error, flags = c.take(BODY)
        yield Body(int(number), (x, y, z), (qw, qx, qy, qz), error, bool(int(flags) & TRACKED))


def _marker(values: tuple[float, ...]) -> Marker:
    number, x, y, z, size, flags, residual = values
    return Marker(int(number) >> 16, int(number) & 0xFFFF, (x, y, z), size, int(flags), residual)


def _point(values: tuple[float, ...]) -> Point:
    x, y, z = values
    return x, y, z
