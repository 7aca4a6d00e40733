"""Converts signals to standard ROS 2 messages, and clients' payloads to values.

A JointState has one value for each joint, with the signal's label as its name. A pose is (x, y, z, qw, qx, qy, qz)
inside the runtime and x, y, z, w in ROS. A wrench is force then torque, a twist linear then angular velocity. A
signal that fits no standard message becomes a Float64MultiArray; a query at `<key>/meta` gives its meaning.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.messages import cdr

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
WRENCH = "geometry_msgs/msg/WrenchStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
POSE = "geometry_msgs/msg/PoseStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
STRING = "std_msgs/msg/String"
JSON = "application/json"

# A signal's term -> the field of JointState that it fills.
_JOINT = {
    "position": "position",
    "position_command": "position",
    "velocity": "velocity",
    "velocity_command": "velocity",
    "effort": "effort",
    "effort_command": "effort",
    "torque": "effort",
    "torque_command": "effort",
}
_STAMPED: dict[tuple[str, tuple[int, ...]], str] = {
    ("wrench", (6,)): WRENCH,
    ("twist", (6,)): TWIST,
    ("pose", (7,)): POSE,
}
LONGEST_VALUES = 1 << 16  # bytes of a client's payload
DIMENSIONS = 32  # of an array, at most
UNIT = 0.01  # by which a quaternion's length may differ from 1
# Of a JointState, the field that holds values of a unit.
_OF_UNIT = {"rad": "position", "m": "position", "1": "position", "rad/s": "velocity", "m/s": "velocity",
            "N m": "effort", "N": "effort"}  # fmt: skip
_SENTINEL = -1.2345678901234567e99  # used to find the place of the first value in a payload


def encoding(kind: str) -> str:
    """The zenoh encoding of a message's payload."""
    return f"application/cdr;{kind}"


def _term(field: Field) -> str:
    return field.name.removesuffix(".applied").removesuffix(".sent").rpartition(".")[2]


def kind_of(field: Field) -> str:
    """The type of the message for a signal."""
    term = _term(field)
    if term in _JOINT and len(field.shape) == 1 and field.frame is None:
        return JOINT_STATE
    return _STAMPED.get((term, field.shape), MULTI_ARRAY)


def time_of(stamp: int) -> dict[str, int]:
    """Converts Unix time in ns to a builtin_interfaces/msg/Time."""
    return {"sec": stamp // 1_000_000_000, "nanosec": stamp % 1_000_000_000}


def joint_names(field: Field) -> list[str]:
    """A name for each element: the labels, or the device's name with a number."""
    owner = field.name.partition(".")[0].replace("-", "_")
    return list(field.labels) if len(field.labels) == field.size else [f"{owner}_{i}" for i in range(field.size)]


def message_of(field: Field, values: Array, stamp: int) -> tuple[str, cdr.Message]:
    """Returns a signal's message: (type, fields).

    Args:
        field: the signal.
        values: its values, of its shape.
        stamp: Unix time, ns.
    """
    kind = kind_of(field)
    header = {"stamp": time_of(stamp), "frame_id": field.frame or ""}
    v = values.ravel()
    if kind == JOINT_STATE:
        arrays = {"position": (), "velocity": (), "effort": ()} | {_JOINT[_term(field)]: v}
        return kind, {"header": header, "name": joint_names(field), **arrays}
    if kind == WRENCH:
        return kind, {"header": header, "wrench": {"force": _xyz(v[:3]), "torque": _xyz(v[3:])}}
    if kind == TWIST:
        return kind, {"header": header, "twist": {"linear": _xyz(v[:3]), "angular": _xyz(v[3:])}}
    if kind == POSE:
        return kind, {
            "header": header,
            "pose": {"position": _xyz(v[:3]), "orientation": _xyz(v[4:]) | {"w": v[3]}},
        }
    return kind, multi_array(values)


def multi_array(values: Array) -> cdr.Message:
    """Converts an array of any shape to a std_msgs/msg/Float64MultiArray, row by row."""
    dims = []
    for axis, size in enumerate(values.shape):
        dims.append({"label": f"axis{axis}", "size": size, "stride": math.prod(values.shape[axis:])})
    return {"layout": {"dim": dims, "data_offset": 0}, "data": values.ravel()}


def _xyz(v: Array) -> dict[str, float]:
    return {"x": v[0], "y": v[1], "z": v[2]}


class Encoder:
    """Encodes a signal's payloads. Only the stamp and the values change, and their places in a payload are fixed."""

    def __init__(self, field: Field) -> None:
        self.kind = kind_of(field)
        self._payload = bytearray(cdr.encode(*message_of(field, np.full(field.shape, _SENTINEL), 0)))
        self._at = self._payload.find(np.float64(_SENTINEL).tobytes()) if field.size else len(self._payload)
        self._end = self._at + 8 * field.size
        self._stamped = self.kind != MULTI_ARRAY
        self._order = [0, 1, 2, 4, 5, 6, 3] if self.kind == POSE else slice(None)

    def encode(self, values: Array, stamp: int) -> bytes:
        """Returns the same bytes as `cdr.encode(*message_of(field, values, stamp))`."""
        if self._stamped:
            self._payload[4:12] = (stamp // 1_000_000_000).to_bytes(4, "little") + (stamp % 1_000_000_000).to_bytes(
                4, "little"
            )
        self._payload[self._at : self._end] = values.ravel()[self._order].tobytes()
        return bytes(self._payload)

    def encode_all(self, values: Array, stamps: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Returns the bytes of many messages, one a row.

        Args:
            values: (k, *shape).
            stamps: (k,) Unix time, ns.
        """
        found = np.tile(np.frombuffer(bytes(self._payload), np.uint8), (len(stamps), 1))
        if self._stamped:
            found[:, 4:12] = np.column_stack(np.divmod(stamps, 1_000_000_000)).astype("<u4").view(np.uint8)
        flat = np.ascontiguousarray(values.reshape(len(stamps), -1)[:, self._order], "<f8")
        found[:, self._at : self._end] = flat.view(np.uint8)
        return found


def values_of(kind: str, message: cdr.Message) -> Array:
    """Returns the values of a message in the runtime's order: the reverse of `message_of`.

    Raises:
        RequestError: this message has no values.
    """
    if kind == JOINT_STATE:
        # The first field that has values: velocity and effort are sent alone.
        return next((message[k] for k in ("position", "velocity", "effort") if len(message[k])), np.empty(0))
    if kind in (WRENCH, TWIST):
        first, second = ("force", "torque") if kind == WRENCH else ("linear", "angular")
        body = message["wrench" if kind == WRENCH else "twist"]
        return np.array([body[part][axis] for part in (first, second) for axis in "xyz"])
    if kind == POSE:
        p, q = message["pose"]["position"], message["pose"]["orientation"]
        return np.array([p["x"], p["y"], p["z"], q["w"], q["x"], q["y"], q["z"]])
    if kind == MULTI_ARRAY:
        data: Array = message["data"]
        shape = [int(dim["size"]) for dim in message["layout"]["dim"]]
        # A shape that numpy doesn't know, of a hundred dimensions or of sizes whose product is 0, is no shape.
        fits = len(shape) <= DIMENSIONS and 0 not in shape and math.prod(shape) == data.size
        return data.reshape(shape) if fits else data
    raise RequestError(f"payload '{kind}'", "this message carries no values of a signal", f"Send {MULTI_ARRAY}")


def describe(field: Field) -> dict[str, Any]:
    """Returns the answer of the metadata queryable, for JSON."""
    return {
        "name": field.name,
        "role": field.role,
        "type": kind_of(field),
        "unit": field.unit,
        "frame": field.frame,
        "labels": list(field.labels),
        "slots": field.slots,
        "components": [list(names) for names in field.components],
        "shape": list(field.shape),
    }


def read_values(payload: bytes, declared: str, field: Field, place: str, rest: Array | None = None) -> Array:
    """Reads the values of a client's payload for a signal and checks that their number fits and all are finite.

    Args:
        payload: JSON (a number or a list) or CDR: Float64MultiArray, a JointState with the field that is in the
            signal's unit, or the signal's own type.
        declared: the sample's zenoh encoding; if it declares none, the payload's first bytes decide.
        field: the signal.
        place: the key, for the error.
        rest: (field.size,): what joints get that a JointState leaves out; None: it must name all.
    Returns:
        (field.size,) float64.
    Raises:
        RequestError: the payload is anything else.
    """
    if len(payload) > LONGEST_VALUES:  # before it is parsed: nobody may keep the bus busy with it
        raise RequestError(place, f"the payload has {len(payload)} bytes", f"Send {LONGEST_VALUES} at most")
    kind = declared.partition(";")[2] if declared.startswith("application/cdr") else ""
    if kind or cdr.is_cdr(payload):
        values = _from_cdr(payload, kind, field, place, rest)
    else:
        values = np.asarray(_from_json(payload, place), np.float64).ravel()
    if values.size != field.size:
        raise RequestError(
            place,
            f"{values.size} values came where the signal has {field.size}",
            f"Send shape {list(field.shape)}, in {field.unit}",
        )
    if not np.isfinite(values).all():
        raise RequestError(place, "a value is NaN or infinite", "Send finite numbers")
    values = values.ravel()
    if kind_of(field) == POSE and not abs((norm := float(np.linalg.norm(values[3:]))) - 1.0) < UNIT:
        raise RequestError(place, f"the quaternion has the length {norm:.4g}", "Send a unit quaternion")
    return values


def _from_cdr(payload: bytes, kind: str, field: Field, place: str, rest: Array | None) -> Array:
    if not kind:
        try:
            return values_of(MULTI_ARRAY, cdr.decode(MULTI_ARRAY, payload))
        except RequestError:
            kind = JOINT_STATE
    message = cdr.decode(kind, payload)
    if kind == MULTI_ARRAY:
        return values_of(kind, message)
    if kind != JOINT_STATE and kind == kind_of(field):
        frame, given = field.frame or "", message["header"]["frame_id"]
        if given != frame:
            raise RequestError(place, f"its frame_id is '{given}'", f"Send it in the signal's frame, '{frame}'")
        return values_of(kind, message)
    if kind != JOINT_STATE:
        raise RequestError(place, f"a setpoint can't be a {kind}", f"Send {MULTI_ARRAY}, {JOINT_STATE} or a JSON list")
    if (part := _OF_UNIT.get(field.unit)) is None:
        raise RequestError(place, f"a JointState has nothing in {field.unit}", f"Send {MULTI_ARRAY} or a JSON list")
    values: Array = message[part]
    names = message["name"]
    if not values.size:
        raise RequestError(place, f"its field '{part}' is empty", f"Give the joints' {part}, in {field.unit}")
    if field.labels and names:
        complete = sorted(names) == sorted(field.labels)
        some = rest is not None and len(set(names)) == len(names) and set(names) <= set(field.labels)
        if not (complete or some) or len(names) != values.size:
            raise RequestError(place, f"the joints are {', '.join(names)}", f"Name these: {', '.join(field.labels)}")
        whole = np.zeros(field.size) if rest is None else rest.copy()
        whole[[field.labels.index(name) for name in names]] = values
        return whole
    return values


def _from_json(payload: bytes, place: str) -> Any:
    remedy = "Send a JSON number or list of numbers, or CDR"
    try:
        content = json.loads(payload)
    except (ValueError, RecursionError):
        raise RequestError(place, "the payload is neither JSON nor CDR", remedy) from None
    if not _numbers(content):
        raise RequestError(place, "the JSON isn't a number or a list of numbers", remedy)
    try:
        return np.array(content, np.float64)
    except (ValueError, OverflowError):
        raise RequestError(place, "the JSON's rows differ in length, or a number is too large", remedy) from None


def _numbers(content: Any, depth: int = 0) -> bool:
    if isinstance(content, list):
        return depth < 4 and all(_numbers(c, depth + 1) for c in content)
    return isinstance(content, int | float) and not isinstance(content, bool)
