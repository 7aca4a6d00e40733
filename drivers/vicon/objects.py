"""Tracker's UDP object stream (sheet vicon_datastream, B.2): one datagram per frame. No I/O."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from srl.drivers.vicon.blocks import MalformedError

SIZES: Final = (256, 512, 1024)
"""Bytes of a datagram, padded."""
_HEAD: Final = struct.Struct("<IB")
_ITEM: Final = struct.Struct("<BH")
_OBJECT: Final = struct.Struct("<24s6d")
_TRACKER_OBJECT: Final = 0


class TrackedObject(NamedTuple):
    """An object: `pose` is x, y, z (mm) and the angles of Rx Ry Rz (rad)."""

    name: str
    pose: tuple[float, float, float, float, float, float]


class ObjectFrame(NamedTuple):
    """One datagram."""

    number: int
    objects: tuple[TrackedObject, ...]


def decode(datagram: bytes) -> ObjectFrame:
    """Parses a datagram. Items of other kinds and the filler after the last item are skipped.

    Raises:
        MalformedError: the datagram is shorter than its items.
    """
    if len(datagram) < _HEAD.size:
        raise MalformedError(f"{len(datagram)} bytes")
    number, count = _HEAD.unpack_from(datagram)
    at, objects = _HEAD.size, []
    for _ in range(count):
        if at + _ITEM.size > len(datagram):
            raise MalformedError(f"{count} items in {len(datagram)} bytes")
        kind, size = _ITEM.unpack_from(datagram, at)
        at += _ITEM.size
        if at + size > len(datagram):
            raise MalformedError(f"an item of {size} bytes at {at} of {len(datagram)}")
        if kind == _TRACKER_OBJECT:
            if size < _OBJECT.size:
                raise MalformedError(f"an object of {size} bytes")
            name, *pose = _OBJECT.unpack_from(datagram, at)
            text = name.partition(b"\0")[0].decode("utf-8", "replace")
            objects.append(TrackedObject(text, tuple(pose)))
        at += size
    return ObjectFrame(number, tuple(objects))


def encode(number: int, objects: Sequence[TrackedObject]) -> bytes:
    """Encodes a datagram, padded with zeros to the smallest fitting size of SIZES; at most 13 objects."""
    parts = [_HEAD.pack(number, len(objects))]
    for name, pose in objects:
        parts += [_ITEM.pack(_TRACKER_OBJECT, _OBJECT.size), _OBJECT.pack(name.encode()[:24], *pose)]
    data = b"".join(parts)
    size = next((size for size in SIZES if size >= len(data)), None)
    if size is None:
        raise ValueError(f"{len(objects)} objects don't fit into {SIZES[-1]} bytes")
    return data.ljust(size, b"\0")
