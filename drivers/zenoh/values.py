"""Extracts the values from a message: which of its fields, in which order, and at which byte offset.

Most samples of a key differ in stamp and values only. So the first one is decoded field by field, and the bytes
between header and values are remembered. A sample with the same bytes there is read in place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from srl.runtime.contracts import terms
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.messages import cdr, messages

POINT = "geometry_msgs/msg/PointStamped"
TWIST = "geometry_msgs/msg/Twist"
JOY = "sensor_msgs/msg/Joy"
BOOL = "std_msgs/msg/Bool"
TYPES = (
    messages.JOINT_STATE,
    messages.MULTI_ARRAY,
    messages.POSE,
    messages.WRENCH,
    messages.TWIST,
    POINT,
    TWIST,
    JOY,
    BOOL,
)
TERMS = {
    messages.POSE: terms.POSE, messages.WRENCH: terms.WRENCH, messages.TWIST: terms.TWIST, TWIST: terms.TWIST,
    POINT: terms.POINT,
}  # fmt: skip
"""The elements of messages that name none."""
_AFTER_STAMP = 12
_POSE_ORDER = np.array([0, 1, 2, 6, 3, 4, 5])  # x y z w of ROS -> w x y z
_JOINT_FIELDS = ("position", "velocity", "effort")


class Reading(NamedTuple):
    """One message's content.

    Attributes:
        values: of the signal's size, flat, in the runtime's order.
        stamp: ns, from the header; -1 if there is no header.
    """

    values: Array
    stamp: int


class Values:
    """Reads one signal's messages."""

    def __init__(self, name: str, size: int, labels: tuple[str, ...], field: str | None, nan: bool) -> None:
        """
        Args:
            name: the signal's name, which decides the field of a JointState unless `field` does.
            size: number of values.
            labels: elements in the wanted order; empty for the sender's order.
            field: see `SignalEntry.field`.
            nan: accept NaN.
        """
        self._size, self._labels, self._nan = size, labels, nan
        self._field = field or next((f for f in _JOINT_FIELDS if name.startswith(f)), "position")
        self._joy = field if field in ("axes", "buttons") else "axes"
        self._kind = ""
        self._length = -1  # length of payloads that can be read in place; -1: none can
        self._known = b""
        self._at = 0
        self._order: Array | None = None
        self._sent: tuple[str, ...] = ()

    def follow(self, names: tuple[str, ...]) -> None:
        """Takes the sender's names of an array's rows, in its order: the message itself has none."""
        self._sent, self._length = names, -1

    def read(self, kind: str, payload: bytes) -> Reading:
        """Returns a payload's values and stamp.

        Args:
            kind: the message's type.
            payload: CDR.
        Raises:
            RequestError: it isn't that message, or its values don't fit the signal.
        """
        if (
            len(payload) == self._length
            and kind == self._kind
            and cdr.is_cdr(payload)
            and payload[_AFTER_STAMP : self._at] == self._known
        ):
            values = np.frombuffer(payload, "<f8", self._size, self._at)
            if self._order is not None:
                values = values[self._order]
            reading = Reading(values, _stamp(payload))
        else:
            reading = self._decode(kind, payload)
        if not self._nan and not math.isfinite(reading.values.sum()):
            raise RequestError(f"payload '{kind}'", "a value is NaN or infinite", "Set `nan: true` to let it through")
        return reading

    def _decode(self, kind: str, payload: bytes) -> Reading:
        if kind not in TYPES:
            raise RequestError(f"payload '{kind}'", "this message isn't read here", nearest(kind, TYPES))
        message = cdr.decode(kind, payload)
        values, order = self._values(kind, message)
        if values.size != self._size:
            raise RequestError(
                f"payload '{kind}'",
                f"it has {values.size} values, the signal {self._size}",
                "Correct `shape`, or the key",
            )
        names = TERMS.get(kind) or (self._sent if kind == messages.MULTI_ARRAY else ())
        if names and self._labels and names != self._labels:
            rows = self._rows(kind, list(names), len(names))
            values, order = values[rows], rows if order is None else order[rows]
        stamp = -1
        if "header" in message:
            time = message["header"]["stamp"]
            stamp = time["sec"] * 10**9 + time["nanosec"]
            self._learn(kind, payload, message, order)
        return Reading(values, stamp if stamp > 0 else -1)

    def _values(self, kind: str, message: cdr.Message) -> tuple[Array, Array | None]:
        """Returns the values in the runtime's order, and that order."""
        if kind == messages.JOINT_STATE:
            return self._joints(message)
        if kind == JOY:
            return np.asarray(message[self._joy], np.float64), None
        if kind == BOOL:
            return np.array([float(message["data"])]), None
        if kind == POINT:
            return np.array([message["point"][axis] for axis in "xyz"]), None
        if kind == TWIST:
            return messages.values_of(messages.TWIST, {"twist": message}), None
        values = messages.values_of(kind, message)
        return values.ravel(), _POSE_ORDER if kind == messages.POSE else None

    def _joints(self, message: cdr.Message) -> tuple[Array, Array | None]:
        values: Array = message[self._field]
        names = message["name"]
        if not self._labels or not names:
            return values, None
        order = self._rows(messages.JOINT_STATE, names, values.size)
        return values[order], order

    def _rows(self, kind: str, names: list[str], count: int) -> Array:
        """The places of the wanted values among the `count` rows that come with these names."""
        if sorted(names) != sorted(self._labels) or len(names) != count:
            raise RequestError(
                f"payload '{kind}'",
                f"its elements are {', '.join(names)}",
                f"Expected {', '.join(self._labels)}: correct `labels`, or the key",
            )
        width = self._size // len(names)
        return np.array([names.index(label) * width + i for label in self._labels for i in range(width)])

    def _learn(self, kind: str, payload: bytes, message: cdr.Message, order: Array | None) -> None:
        """Remembers the place of the values, if they are consecutive doubles."""
        self._length = -1
        if kind in (JOY, BOOL) or (kind == messages.JOINT_STATE and self._field != "position"):
            return
        size = 8 * self._size
        if kind == messages.JOINT_STATE:
            bare = message | {"velocity": (), "effort": ()}
            at = len(cdr.encode(kind, bare)) - 8 - size  # two empty sequences follow
        else:
            at = len(cdr.encode(kind, message)) - size
        self._kind, self._length, self._at, self._order = kind, len(payload), at, order
        self._known = payload[_AFTER_STAMP:at]


def type_of(encoding: str) -> str:
    """Returns the message type in a zenoh encoding; "" if it declares none."""
    form, _, kind = encoding.partition(";")
    return kind if form == "application/cdr" else ""


def _stamp(payload: bytes) -> int:
    stamp = int.from_bytes(payload[4:8], "little", signed=True) * 10**9 + int.from_bytes(payload[8:12], "little")
    return stamp if stamp > 0 else -1
