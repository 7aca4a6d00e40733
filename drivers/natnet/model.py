"""NatNet's model definitions, 3.0 to 4.x (sheet optitrack_natnet, 7): the names behind the numbers. No I/O."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from srl.drivers.capture.names import Marker, Point, Segment, Subject
from srl.drivers.natnet.protocol import Cursor, MalformedError, Version

MARKER_SET, RIGID_BODY, SKELETON, FORCE_PLATE, DEVICE, CAMERA, ASSET = range(7)
_OFFSET: Final = struct.Struct("<ii3f")
_POINT: Final = struct.Struct("<3f")
_PLATE: Final = struct.Struct("<2f3f144f12fii")
_CAMERA: Final = struct.Struct("<7f")
_ASSET_MARKER: Final = struct.Struct("<i3ffh")
TURNED: Final = Version(4, 2)  # bodies have a rotation offset
NAMED: Final = Version(4, 0)  # markers of bodies have names
SIZED: Final = Version(4, 1)  # each description says its bytes
KIND: Final = 1 << 32  # a skeleton's subject number is its own plus this: a rigid body may have the same


class BodyModel(NamedTuple):
    """A rigid body or bone: `offset` (m) from its parent, `markers` by name ("" before 4.0)."""

    name: str
    id: int
    parent: int
    offset: Point
    markers: tuple[str, ...]


class Model(NamedTuple):
    """Everything that has a name.

    Attributes:
        sets: markers of each marker set, in order. bodies: rigid bodies. skeletons: (name, number, bones).
    """

    sets: dict[str, tuple[str, ...]]
    bodies: tuple[BodyModel, ...]
    skeletons: tuple[tuple[str, int, tuple[BodyModel, ...]], ...]

    def subjects(self) -> tuple[Subject, ...]:
        """Rigid bodies as subjects of one segment, skeletons as subjects whose segments are the bones."""
        made = []
        for body in self.bodies:
            markers = self._markers(body.name, body.markers)
            made.append(Subject(body.id, body.name, (Segment(body.id, body.name, 0),), markers))
        for name, number, bones in self.skeletons:
            segments = tuple(Segment(bone.id, bone.name, max(bone.parent, 0)) for bone in bones)
            markers = self._markers(name, tuple(marker for bone in bones for marker in bone.markers))
            made.append(Subject(KIND + number, name, segments, markers))
        return tuple(made)

    def _markers(self, name: str, own: tuple[str, ...]) -> tuple[Marker, ...]:
        """An asset's markers: named by the marker set of its name, else by itself, else by their numbers."""
        names = self.sets.get(name) or own
        return tuple(Marker(i, given or f"Marker{i}") for i, given in enumerate(names, 1))


def decode(payload: bytes, version: Version) -> Model:
    """Decodes model definitions. Unknown types are left out from 4.1 on.

    Raises:
        MalformedError: the bytes aren't such definitions of this version.
    """
    c = Cursor(payload)
    sets: dict[str, tuple[str, ...]] = {}
    bodies: list[BodyModel] = []
    skeletons: list[tuple[str, int, tuple[BodyModel, ...]]] = []
    for _ in range(c.count(4)):
        kind = c.whole()
        end = None
        if version >= SIZED:
            size = c.whole()
            if not 0 <= size <= c.left:
                raise MalformedError(f"a description of {size} bytes, {c.left} are left")
            end = c.at + size
        if kind == MARKER_SET:
            name = c.text()
            sets[name] = _names(c)
        elif kind == RIGID_BODY:
            bodies.append(_body(c, version))
        elif kind == SKELETON:
            name, number = c.text(), c.whole()
            skeletons.append((name, number, tuple(_body(c, version) for _ in range(c.count(24)))))
        elif end is None:
            _leave_out(c, kind)
        if end is not None:
            # What a later version has behind the known fields, or the whole of what isn't needed.
            c.skip(end - c.at)
    return Model(sets, tuple(bodies), tuple(skeletons))


def _body(c: Cursor, version: Version) -> BodyModel:
    name = c.text()
    number, parent, x, y, z = c.take(_OFFSET)
    if version >= TURNED:
        c.skip(16)
    count = c.count(16)
    c.skip(count * 16)  # all positions, then all active labels
    names = tuple(c.text() for _ in range(count)) if version >= NAMED else ("",) * count
    return BodyModel(name, int(number), int(parent), (x, y, z), names)


def _names(c: Cursor) -> tuple[str, ...]:
    return tuple(c.text() for _ in range(c.count(1)))


def _leave_out(c: Cursor, kind: int) -> None:
    """Reads over what isn't needed, where its size isn't said."""
    if kind == FORCE_PLATE:
        c.whole()
        c.text()
        c.take(_PLATE)
        _names(c)
    elif kind == DEVICE:
        c.whole()
        c.text(), c.text()
        c.skip(8)
        _names(c)
    elif kind == CAMERA:
        c.text()
        c.take(_CAMERA)
    else:
        raise MalformedError(f"a description of type {kind}")
