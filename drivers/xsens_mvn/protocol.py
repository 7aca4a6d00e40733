"""MVN's network streamer: datagrams of segments, joint angles and the centre of mass (sheet xsens_mvn). No I/O.

Big-endian. Every function that takes bytes takes any; what isn't such a datagram raises `MalformedError`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from math import isfinite
from typing import Final, NamedTuple

PORT: Final = 9763
HEADER: Final = struct.Struct(">6sIBBIBBBBHH")  # 24 bytes
_MAGIC: Final = b"MXTP"
POSES, JOINTS, CENTRE = 2, 20, 24
_POSE: Final = struct.Struct(">i7f")
_JOINT: Final = struct.Struct(">ii3f")
_POINT: Final = struct.Struct(">3f")
LAST: Final = 0x80  # of the datagram counter: the sample's last
_KNOWN: Final = frozenset((1, 2, 3, 5, 12, 13, 20, 21, 22, 23, 24, 25))
FARTHEST: Final = 1e4  # m: who wears the suit may walk far
_UNIT: Final = 1e-2  # by which a quaternion's length may differ from 1
_MOST: Final = 67  # segments, with props and both hands
_LONGEST: Final = 36  # bytes of a centre of mass with velocity and acceleration

SEGMENTS: Final = (
    "Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head",
    "RightShoulder", "RightUpperArm", "RightForeArm", "RightHand",
    "LeftShoulder", "LeftUpperArm", "LeftForeArm", "LeftHand",
    "RightUpperLeg", "RightLowerLeg", "RightFoot", "RightToe",
    "LeftUpperLeg", "LeftLowerLeg", "LeftFoot", "LeftToe",
)  # fmt: skip
"""A body's segments in the wire's order; ids begin at 1."""
JOINT_ENDS: Final = {
    "L5S1": (1, 2), "L4L3": (2, 3), "L1T12": (3, 4), "T9T8": (4, 5), "T1C7": (5, 6), "C1Head": (6, 7),
    "RightT4Shoulder": (5, 8), "RightShoulder": (8, 9), "RightElbow": (9, 10), "RightWrist": (10, 11),
    "LeftT4Shoulder": (5, 12), "LeftShoulder": (12, 13), "LeftElbow": (13, 14), "LeftWrist": (14, 15),
    "RightHip": (1, 16), "RightKnee": (16, 17), "RightAnkle": (17, 18), "RightBallFoot": (18, 19),
    "LeftHip": (1, 20), "LeftKnee": (20, 21), "LeftAnkle": (21, 22), "LeftBallFoot": (22, 23),
}  # fmt: skip
"""The joints between them: ids of parent and child. So a joint is found whatever the order in the stream."""


class MalformedError(ValueError):
    """These bytes aren't such a datagram."""


class Datagram(NamedTuple):
    """One datagram.

    Attributes:
        kind: the message type. sample: the sample counter. part: of the sample's datagrams, from 0; last: the last one.
        items: their number here. time: ms since the recording began. character: which person.
        payload: behind the header.
    """

    kind: int
    sample: int
    part: int
    last: bool
    items: int
    time: int
    character: int
    payload: bytes


class Pose(NamedTuple):
    """A segment in the world: m; w, x, y, z."""

    segment: int
    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


def split(data: bytes) -> Datagram:
    """Decodes the header. Bytes behind the payload are left out.

    Raises:
        MalformedError: no such header, or the datagram was cut.
    """
    if len(data) < HEADER.size:
        raise MalformedError(f"{len(data)} bytes")
    head, sample, counter, items, time, character, _, _, _, _, size = HEADER.unpack_from(data)
    if head[:4] != _MAGIC or not head[4:].isdigit():
        raise MalformedError(f"it begins with {head[:6]!r}")
    kind = int(head[4:])
    if kind not in _KNOWN:
        raise MalformedError(f"type {kind}")
    there = len(data) - HEADER.size
    size = size or there  # before MVN 2019 these bytes are reserved
    if size > there:
        raise MalformedError(f"{size} bytes of payload announced, {there} came")
    payload = data[HEADER.size : HEADER.size + size]
    return Datagram(kind, sample, counter & ~LAST, bool(counter & LAST), items, time, character, payload)


def poses(items: int, payload: bytes) -> list[Pose]:
    """Decodes type 02. Props and fingers come behind the body's segments and are left out."""
    _sized(items, payload, _POSE.size)
    found = []
    for at in range(0, items * _POSE.size, _POSE.size):
        segment, x, y, z, qw, qx, qy, qz = _POSE.unpack_from(payload, at)
        if not 1 <= segment <= _MOST:
            raise MalformedError(f"segment {segment}")
        size = qw * qw + qx * qx + qy * qy + qz * qz
        # Of a prop, or of fingers without gloves, there may be none: that spoils no other segment.
        if not abs(x) + abs(y) + abs(z) < FARTHEST or not abs(size**0.5 - 1.0) <= _UNIT:
            continue
        if segment <= len(SEGMENTS):
            found.append(Pose(segment, (x, y, z), (qw, qx, qy, qz)))
    if not found and items:
        raise MalformedError("no segment of the body has a pose")
    return found


def joints(items: int, payload: bytes) -> dict[tuple[int, int], tuple[float, float, float]]:
    """Decodes type 20: degrees about x, y, z, by the ids of the two segments; of several for one pair, the first."""
    _sized(items, payload, _JOINT.size)
    found: dict[tuple[int, int], tuple[float, float, float]] = {}
    for at in range(0, items * _JOINT.size, _JOINT.size):
        parent, child, x, y, z = _JOINT.unpack_from(payload, at)
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            raise MalformedError(f"joint {parent}, {child} has no angles")
        found.setdefault((parent >> 8, child >> 8), (x, y, z))
    return found


def centre(payload: bytes) -> tuple[float, float, float]:
    """Decodes type 24: m; the position alone, or with velocity and acceleration."""
    if len(payload) not in (_POINT.size, _LONGEST):
        raise MalformedError(f"a centre of mass of {len(payload)} bytes")
    x, y, z = _POINT.unpack_from(payload)
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        raise MalformedError("a centre of mass that is none")
    return x, y, z


def encode(
    kind: int, sample: int, time: int, payload: bytes, items: int, *, character: int = 0, index: int = 0,
    last: bool = True, fingers: int = 0, sized: bool = True,
) -> bytes:  # fmt: skip
    """A datagram; `sized`: as from MVN 2019 on, with the character's counts and the payload's size."""
    head = _MAGIC + b"%02d" % kind
    rest = (len(SEGMENTS), 0, fingers, 0, len(payload)) if sized else (0, 0, 0, 0, 0)
    return HEADER.pack(head, sample, index | LAST * last, items, time, character, *rest) + payload


def encode_poses(made: Iterable[Pose]) -> bytes:
    """The payload of type 02."""
    return b"".join(_POSE.pack(pose.segment, *pose.position, *pose.rotation) for pose in made)


def encode_joint(parent: int, child: int, degrees: Iterable[float]) -> bytes:
    """An item of type 20."""
    return _JOINT.pack(parent, child, *degrees)


def encode_centre(position: Iterable[float]) -> bytes:
    """The payload of type 24, in its long form."""
    return _POINT.pack(*position) + bytes(_LONGEST - _POINT.size)


def _sized(items: int, payload: bytes, size: int) -> None:
    if items * size != len(payload):
        raise MalformedError(f"{items} items of {size} bytes in {len(payload)}")
