"""The DataStream's packets and requests (sheet vicon_datastream, A.1 to A.3). No I/O.

A packet is a sequence of blocks; a block is a type, a length and a body. All numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

PORT: Final = 801
OBJECTS: Final = 0x1A2B0001
"""The type of a packet."""
LARGEST: Final = 1 << 20
"""Bytes in a packet's blocks; a server that sends poses and markers only stays far below."""
CLOCK: Final = 135_000_000
"""Hz, of the ticks in which the frame period is given."""

_MAGIC: Final = OBJECTS.to_bytes(4, "little")
_HEAD: Final = struct.Struct("<II")
_MORE, _WRONG = -1, -2  # returned instead of a packet's end: incomplete; not a packet


class Block(IntEnum):
    """Types of blocks (A.2) that this project reads or sends."""

    STREAM_INFO = 1
    SUBJECT_INFO = 2
    FRAME_INFO = 5
    LABELED_RECONS = 6
    UNLABELED_RECONS = 7
    LOCAL_SEGMENTS = 8
    GLOBAL_SEGMENTS = 9
    TIMECODE = 23
    LATENCY_INFO = 26
    SUBJECT_TOPOLOGY = 28
    SUBJECT_HEALTH = 29
    HARDWARE_FRAME_INFO = 36
    APPLICATION_INFO = 37
    FRAME_RATE_INFO = 39
    OBJECT_QUALITY = 40
    PING = 42
    LIGHTWEIGHT_SEGMENTS = 901
    SUBJECT_SCALE = 28001
    OBJECT_ENUMS = 100001
    REQUEST_FRAME = 100002
    KEEP_ALIVE = 100003
    CONTENTS = 100004
    START_MULTICAST = 100005
    STOP_MULTICAST = 100006
    FILTER = 100007
    REQUEST_NEXT_FRAME = 100008


class Item(NamedTuple):
    """One block of a packet: its type and its body."""

    type: int
    body: memoryview


Packet = list[Item]


class Parser:
    """Cuts a byte stream into packets; the result doesn't depend on how the stream was split.

    A packet counts only if its blocks fill it exactly. If they don't, or its length is impossible, bytes were lost or
    added: the parser then looks for the next packet's head. If a length is too great but possible, the next packets lie
    inside the length it claims: a whole packet found there ends the wait.

    Attributes:
        frames: good packets. errors: number of times bytes were discarded. resyncs: number of times sync was lost.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.errors = 0
        self.resyncs = 0
        self._buffer = bytearray()
        self._lost = False

    def feed(self, data: bytes) -> list[Packet]:
        """Returns the packets that `data` completes, in order. Keeps at most LARGEST + 8 bytes besides `data`."""
        buffer = self._buffer
        buffer += data
        found: list[Packet] = []
        at = 0
        while True:
            if self._lost:
                start = buffer.find(_MAGIC, at)
                if start < 0:
                    at = max(at, len(buffer) - 3)
                    break
                at = start
            end, places = _walk(buffer, at)
            if end == _MORE:
                inside = self._inside(at)
                if inside < 0:
                    break
                self._lose()
                at = inside
            elif end == _WRONG:
                self._lose()
                at += 1
            else:
                content = memoryview(bytes(buffer[at:end]))
                found.append([Item(kind, content[start:stop]) for kind, start, stop in places])
                self.frames += 1
                self._lost = False
                at = end
        del buffer[:at]
        return found

    def _inside(self, at: int) -> int:
        """Returns where a whole packet lies inside the incomplete one at `at`; -1 if nowhere."""
        inside = self._buffer.find(_MAGIC, at + 8)
        while inside >= 0 and _walk(self._buffer, inside)[0] < 0:
            inside = self._buffer.find(_MAGIC, inside + 1)
        return inside

    def _lose(self) -> None:
        if not self._lost:
            self.errors += 1
            self.resyncs += 1
            self._lost = True


def _walk(buffer: bytearray, at: int) -> tuple[int, list[tuple[int, int, int]]]:
    """Returns the index after the packet at `at`, or _MORE or _WRONG; type, begin, end (from `at`) of its blocks."""
    places: list[tuple[int, int, int]] = []
    size = len(buffer) - at
    if size < 8:
        return (_MORE if _MAGIC.startswith(bytes(buffer[at : at + 4])) else _WRONG), places
    kind, length = _HEAD.unpack_from(buffer, at)
    if kind != OBJECTS or length > LARGEST:
        return _WRONG, places
    whole, next_block = 8 + length, 8
    while next_block < whole:
        if next_block + 8 > whole:
            return _WRONG, places
        if next_block + 8 > size:
            return _MORE, places
        kind, length = _HEAD.unpack_from(buffer, at + next_block)
        stop = next_block + 8 + length
        if stop > whole or kind in (0, OBJECTS):
            return _WRONG, places
        places.append((kind, next_block + 8, stop))
        next_block = stop
    return (at + whole if size >= whole else _MORE), places


def block(kind: int, body: bytes = b"") -> bytes:
    """Encodes a block with its head."""
    return _HEAD.pack(kind, len(body)) + body


def packet(*blocks: bytes) -> bytes:
    """Encodes a packet from whole blocks."""
    return block(OBJECTS, b"".join(blocks))


def object_enums(kinds: Iterable[int]) -> bytes:
    """Encodes the types of blocks that are offered (server) or wanted (client)."""
    ordered = sorted(set(kinds))
    return packet(block(Block.OBJECT_ENUMS, struct.pack(f"<{1 + len(ordered)}I", len(ordered), *ordered)))


def request_frame(streaming: bool) -> bytes:
    """Requests one frame, which also ends streaming, or from now on one packet per frame."""
    return packet(block(Block.REQUEST_FRAME, bytes([streaming])))


def request_next_frame(count: int = 1) -> bytes:
    """Requests the next frames that become available."""
    return packet(block(Block.REQUEST_NEXT_FRAME, struct.pack("<I", count)))


def ping(number: int) -> bytes:
    """Requests an echo."""
    return packet(block(Block.PING, struct.pack("<Q", number)))
