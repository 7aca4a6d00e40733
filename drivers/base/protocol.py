"""The messages of a ROS 2 base: odometry and e-stop in, velocity out; ROS 2 CDR, little endian.

Source: protocol sheet summit-xl-zenoh, sections 1 and 3.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array
from srl.runtime.messages import cdr

ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
BOOL = "std_msgs/msg/Bool"

STAMP_AT = 4  # offset of the stamp in TwistStamped
LONGEST_FRAME = 256  # bytes
TILT = 0.02  # limit of a quaternion's x and y: a base on wheels can't tilt further
_UINT = struct.Struct("<I")
_STAMP = struct.Struct("<iI")
_POSE = struct.Struct("<7d")
_TWIST = struct.Struct("<6d")
_COVARIANCE = 36 * 8
_HEADER = len(cdr.HEADER)
_FRAMES = ("base_link", "base_footprint")


@dataclass(frozen=True, slots=True)
class Odometry:
    """One odometry message.

    Attributes:
        stamp: ns of the robot's clock.
        frame, child_frame: the pose is child_frame in frame, the twist is in child_frame.
        pose: x (m), y (m), yaw (rad, -pi to pi).
        twist: vx (m/s), vy (m/s), wz (rad/s), in child_frame.
    """

    stamp: int
    frame: str
    child_frame: str
    pose: tuple[float, float, float]
    twist: tuple[float, float, float]


class OdometryReader:
    """Reads nav_msgs/Odometry, each message on its own: zenoh keeps the messages' bounds.

    A message is counted and discarded if it is cut short, has a number that isn't finite, has an invalid
    quaternion, or is tilted.

    Attributes:
        frames, errors: messages accepted, and discarded.
        problem: the problem with the last discarded message.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.errors = 0
        self.problem = ""

    def feed(self, payload: bytes) -> list[Odometry]:
        """Returns the message of a payload; none if it is invalid. Never raises."""
        try:
            message = read_odometry(payload)
        except ValueError as error:
            self.errors += 1
            self.problem = str(error)
            return []
        self.frames += 1
        return [message]


def read_odometry(payload: bytes) -> Odometry:
    """Decodes a payload. Raises ValueError with the problem."""
    if not cdr.is_cdr(payload):
        raise ValueError("it doesn't begin with 00 01 00 00 (CDR, little endian)")
    try:
        seconds, nanoseconds = _STAMP.unpack_from(payload, _HEADER)
        frame, at = _string(payload, _HEADER + _STAMP.size)
        child, at = _string(payload, at)
        at = _HEADER + (at - _HEADER + 7) // 8 * 8
        x, y, z, qx, qy, qz, qw = _POSE.unpack_from(payload, at)
        vx, vy, vz, wx, wy, wz = _TWIST.unpack_from(payload, at + _POSE.size + _COVARIANCE)
    except struct.error:
        raise ValueError(f"it is cut short ({len(payload)} bytes)") from None
    end = at + _POSE.size + _TWIST.size + 2 * _COVARIANCE
    if not end <= len(payload) <= end + 3:
        raise ValueError(f"it has {len(payload)} bytes where {end} are right")
    if not math.isfinite(x + y + z + qx + qy + qz + qw + vx + vy + vz + wx + wy + wz):
        raise ValueError("a number isn't finite")
    if nanoseconds >= 10**9 or seconds < 0:
        raise ValueError("its stamp isn't a time")
    if abs(qx * qx + qy * qy + qz * qz + qw * qw - 1.0) > 0.01:
        raise ValueError("its orientation isn't a unit quaternion")
    if max(abs(qx), abs(qy)) > TILT:
        raise ValueError("its orientation isn't a turn about the vertical")
    yaw = rotation.yaw(qw, qx, qy, qz)
    return Odometry(seconds * 10**9 + nanoseconds, frame, child, (x, y, yaw), (vx, vy, wz))


def _string(payload: bytes, at: int) -> tuple[str, int]:
    at = _HEADER + (at - _HEADER + 3) // 4 * 4
    (length,) = _UINT.unpack_from(payload, at)
    end = at + 4 + length
    if not 0 < length <= LONGEST_FRAME or end > len(payload) or payload[end - 1]:
        raise ValueError("a frame's name isn't a string")
    return payload[at + 4 : end - 1].decode("utf-8", "replace"), end


def odometry(message: Odometry) -> bytes:
    """Encodes a message; covariances zero. For twins."""
    x, y, yaw = message.pose
    vx, vy, wz = message.twist
    none = [0.0] * 36
    return cdr.encode(
        ODOMETRY,
        {
            "header": {
                "stamp": {"sec": message.stamp // 10**9, "nanosec": message.stamp % 10**9},
                "frame_id": message.frame,
            },
            "child_frame_id": message.child_frame,
            "pose": {
                "pose": {
                    "position": {"x": x, "y": y, "z": 0.0},
                    "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)},
                },
                "covariance": none,
            },
            "twist": {
                "twist": {"linear": {"x": vx, "y": vy, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": wz}},
                "covariance": none,
            },
        },
    )


def velocity(kind: str, vx: float, vy: float, wz: float) -> bytes:
    """Encodes a velocity command. kind: TWIST, or TWIST_STAMPED (its stamp, at STAMP_AT, stays 0)."""
    twist = _TWIST.pack(vx, vy, 0.0, 0.0, 0.0, wz)
    if kind == TWIST:
        return cdr.HEADER + twist
    # Stamp 0, the empty frame's length and NUL, and 3 bytes of padding to 16.
    return cdr.HEADER + _STAMP.pack(0, 0) + _UINT.pack(1) + bytes(4) + twist


def read_velocity(payload: bytes) -> tuple[float, float, float, int | None]:
    """Decodes either kind of command to vx, vy, wz and its stamp in ns. For twins. Raises ValueError."""
    try:
        if len(payload) == _HEADER + _TWIST.size:
            stamp, twist = None, cdr.decode(TWIST, payload)
        else:
            message = cdr.decode(TWIST_STAMPED, payload)
            time, twist = message["header"]["stamp"], message["twist"]
            stamp = time["sec"] * 10**9 + time["nanosec"]
    except RequestError as error:
        raise ValueError(str(error)) from None
    return twist["linear"]["x"], twist["linear"]["y"], twist["angular"]["z"], stamp


def read_bool(payload: bytes) -> bool | None:
    """Decodes std_msgs/Bool; None if it isn't one."""
    try:
        return bool(cdr.decode(BOOL, payload)["data"])
    except RequestError:
        return None


def frame_fits(child: str, wanted: str | None) -> bool:
    """Returns whether an odometry's child frame is the base: the wanted frame, or one with a usual name."""
    return child == wanted if wanted is not None else child.endswith(_FRAMES)


def carried(pose: Array, twist: Array, seconds: float) -> tuple[float, float, float]:
    """Extrapolates a pose (x, y, yaw) by a constant twist (vx, vy, wz in the base's frame), along an arc."""
    x, y, yaw = pose.tolist()
    vx, vy, wz = twist.tolist()
    turn = wz * seconds
    # The chord of the arc: sin(a)/a along the heading at half the turn.
    half = 0.5 * turn
    chord = seconds * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    c, s = math.cos(yaw + half) * chord, math.sin(yaw + half) * chord
    return x + c * vx - s * vy, y + s * vx + c * vy, yaw + turn
