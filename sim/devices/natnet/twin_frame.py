"""Bodies of NatNet's frames and model definitions, as Motive makes them (sheet optitrack_natnet, 5 and 7)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from srl.drivers.natnet.frame import BODY, COUNTED, MARKER, POINT, PTP, SUFFIX, TAIL, Body, Marker, MotiveFrame
from srl.drivers.natnet.model import MARKER_SET, NAMED, RIGID_BODY, SIZED, SKELETON, TURNED, BodyModel, Model
from srl.drivers.natnet.protocol import Message, Version, packet

_I32: Final = struct.Struct("<i")
_NO_PARENT: Final = -1
Points = Sequence[Sequence[float]]


def frame(seen: MotiveFrame, sets: Mapping[str, Points], version: Version, ptp: tuple[int, int] = (0, 0)) -> bytes:
    """The datagram of a frame.

    Args:
        seen: what the frame has. sets: m, the markers of each marker set.
        version: of the stream. ptp: s and fraction of the precision time stamp, from 4.1 on.
    """
    listed = [_text(name) + _I32.pack(len(points)) + _points(points) for name, points in sets.items()]
    skeletons = [_I32.pack(number) + _listed(map(_body, bones)) for number, bones in seen.skeletons.items()]
    sections: list[list[bytes]] = [
        listed, [POINT.pack(*p) for p in seen.others], [_body(body) for body in seen.bodies], skeletons,
    ]  # fmt: skip
    if version >= COUNTED:
        sections.append([])  # assets
    sections += [[_marker(marker) for marker in seen.markers], [], []]
    parts = [_I32.pack(seen.number)]
    for items in sections:
        data = b"".join(items)
        parts.append(_I32.pack(len(items)))
        if version >= COUNTED:
            parts.append(_I32.pack(len(data)))
        parts.append(data)
    parts.append(SUFFIX.pack(0, 0, seen.time, seen.exposed, seen.received, seen.sent))
    if version >= COUNTED:
        parts.append(PTP.pack(*ptp))
    return packet(Message.FRAME, b"".join([*parts, TAIL.pack(seen.flags, 0)]))


def model(made: Model, places: Mapping[str, Points], version: Version) -> bytes:
    """The datagram of the model definitions; `places`: m, markers on the rigid body, by its name."""
    described = [(MARKER_SET, _text(name) + _listed(map(_text, markers))) for name, markers in made.sets.items()]
    described += [(RIGID_BODY, _described(body, places.get(body.name, ()), version)) for body in made.bodies]
    for name, number, bones in made.skeletons:
        inner = _listed(_described(bone, (), version) for bone in bones)
        described.append((SKELETON, _text(name) + _I32.pack(number) + inner))
    parts = [_I32.pack(len(described))]
    for kind, body in described:
        parts.append(_I32.pack(kind) + (_I32.pack(len(body)) if version >= SIZED else b"") + body)
    return packet(Message.MODEL, b"".join(parts))


def _described(body: BodyModel, places: Points, version: Version) -> bytes:
    parent = body.parent or _NO_PARENT
    parts = [_text(body.name), struct.pack("<ii3f", body.id, parent, *body.offset)]
    if version >= TURNED:
        parts.append(struct.pack("<4f", 0, 0, 0, 1))
    places = places if len(places) == len(body.markers) else [(0.0, 0.0, 0.0)] * len(body.markers)
    parts += [_I32.pack(len(places)), _points(places), bytes(4 * len(places))]
    if version >= NAMED:
        parts += map(_text, body.markers)
    return b"".join(parts)


def _body(body: Body) -> bytes:
    w, x, y, z = body.rotation
    return BODY.pack(body.id, *body.position, x, y, z, w, body.error, int(body.tracked))


def _marker(marker: Marker) -> bytes:
    number = marker.owner << 16 | marker.member
    return MARKER.pack(number, *marker.position, marker.size, marker.flags, marker.residual)


def _listed(items: Iterable[bytes]) -> bytes:
    made = list(items)
    return _I32.pack(len(made)) + b"".join(made)


def _points(points: Points) -> bytes:
    return b"".join(POINT.pack(*p) for p in points)


def _text(name: str) -> bytes:
    return name.encode() + b"\0"
