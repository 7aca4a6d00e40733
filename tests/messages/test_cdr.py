"""CDR against rosbags, an independent implementation, and the protocol sheet's golden vectors."""

from __future__ import annotations

import contextlib
import hashlib
from typing import Any

import numpy as np
import pytest
from helpers import ros2_types
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores

from srl.runtime.contracts.errors import RequestError
from srl.runtime.messages import cdr, messages
from srl.runtime.messages.definitions import INDEXED

STORE = ros2_types.store(Stores.ROS2_HUMBLE)
KILTED = ros2_types.store(Stores.ROS2_KILTED, indexed=True)
TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=20)
FLOAT = st.floats(allow_nan=False)
NUMBERS: dict[str, Any] = {
    "int8": st.integers(-128, 127),
    "uint8": st.integers(0, 127),  # one use is ROS 2's `byte`, which rosbags takes as signed
    "uint16": st.integers(0, 2**16 - 1),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint64": st.integers(0, 2**64 - 1),
    "float32": st.floats(allow_nan=False, width=32),
    "float64": FLOAT,
    "bool": st.booleans(),
    "string": TEXT,
}


def test_a_shape_that_is_none_is_no_error() -> None:
    for sizes in ([1] * 64 + [2], [0, 2**32 - 1, 2**32 - 1, 2**32 - 1]):
        dims = [{"label": "", "size": size, "stride": 1} for size in sizes]
        count = 0 if 0 in sizes else 2
        message = {"layout": {"dim": dims, "data_offset": 0}, "data": np.zeros(count)}
        assert messages.values_of(messages.MULTI_ARRAY, message).shape == (count,)


def values(kind: str) -> st.SearchStrategy[Any]:
    """Any message of a kind."""
    if kind.endswith("]"):
        base, size = kind[:-1].split("[")
        inner = values(base)
        return st.lists(inner, min_size=int(size), max_size=int(size)) if size else st.lists(inner, max_size=5)
    if kind in NUMBERS:
        return NUMBERS[kind]
    return st.fixed_dictionaries({name: values(inner) for name, inner in cdr.TYPES[kind]})


def foreign(kind: str, value: Any) -> Any:
    """The same message as rosbags holds it."""
    if kind.endswith("]"):
        base = kind.partition("[")[0]
        if base in NUMBERS and base != "string":
            return np.array(value, base)
        return [foreign(base, v) for v in value]
    if kind in NUMBERS:
        return value
    store, name = home(kind)
    return store.types[name](**{name: foreign(inner, value[name]) for name, inner in cdr.TYPES[kind]})


def home(kind: str) -> tuple[Any, str]:
    """The store and the name of a kind in rosbags."""
    return (KILTED, kind.removesuffix(INDEXED)) if kind.endswith(INDEXED) else (STORE, kind)


def same(ours: Any, theirs: Any) -> bool:
    if isinstance(ours, dict):
        return all(same(v, theirs[k] if isinstance(theirs, dict) else getattr(theirs, k)) for k, v in ours.items())
    if isinstance(ours, list) and ours and isinstance(ours[0], dict):
        return len(ours) == len(theirs) and all(same(a, b) for a, b in zip(ours, theirs, strict=True))
    return bool(np.array_equal(ours, theirs)) if isinstance(ours, np.ndarray | list) else ours == theirs


@pytest.mark.parametrize("kind", sorted(cdr.TYPES))
def test_definitions_are_those_of_ros2(kind: str) -> None:
    store, known = home(kind)
    names = [name for name, _ in store.fielddefs[known][1]]
    assert [name for name, _ in cdr.TYPES[kind]] == names


@pytest.mark.parametrize("kind", sorted(cdr.TYPES))
@settings(max_examples=12)
@given(data=st.data())
def test_bytes_equal_rosbags_both_ways(kind: str, data: st.DataObject) -> None:
    message = data.draw(values(kind))
    store, known = home(kind)
    theirs = bytes(store.serialize_cdr(foreign(kind, message), known))
    ours = cdr.encode(kind, message)
    assert ours == theirs
    assert same(cdr.decode(kind, theirs), store.deserialize_cdr(ours, known))


def odometry(frame: str, child: str) -> dict[str, Any]:
    covariance = np.diag([0.001, 0.001, 1e6, 1e6, 1e6, 1000.0]).ravel()
    half = 0.7071067811865476
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    pose = {"position": {"x": 1.0, "y": 2.0, "z": 0.0}, "orientation": zero | {"z": half, "w": half}}
    twist = {"linear": zero | {"x": 0.5}, "angular": zero | {"z": 0.1}}
    return {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 250_000_000}, "frame_id": frame},
        "child_frame_id": child,
        "pose": {"pose": pose, "covariance": covariance},
        "twist": {"twist": twist, "covariance": covariance},
    }


@pytest.mark.parametrize(
    ("frame", "child", "size", "digest"),
    [
        ("odom", "base_link", 724, "625c87e9048425883e0e76710973dea9641fde33c0dfc5bc5f07b2714d0f31cb"),
        ("odom", "base_footprint", 724, "9ed2dcf8b1361bb345e51d2bc27dfec2c20c61b5e48876c16086be45651da05e"),
        (
            "robot_odom",
            "robot_base_footprint",
            740,
            "e88796057321abd663efc44c2d2c55c9d8794aa3271c897c30e4c2a6873bb870",
        ),
    ],
)
def test_odometry_is_golden(frame: str, child: str, size: int, digest: str) -> None:
    payload = cdr.encode("nav_msgs/msg/Odometry", odometry(frame, child))
    assert (len(payload), hashlib.sha256(payload).hexdigest()) == (size, digest)


@given(st.sampled_from(sorted(cdr.TYPES)), st.binary(max_size=200))
def test_garbage_is_a_request_error_or_a_message(kind: str, payload: bytes) -> None:
    for data in (payload, cdr.HEADER + payload):
        with contextlib.suppress(RequestError):
            cdr.decode(kind, data)


@pytest.mark.parametrize(
    "kind", ["nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"]
)
@settings(max_examples=40)
@given(data=st.data())
def test_a_cut_payload_is_refused(kind: str, data: st.DataObject) -> None:
    payload = cdr.encode(kind, data.draw(values(kind)))
    cut = data.draw(st.integers(0, len(payload) - 1))
    with pytest.raises(RequestError):
        cdr.decode(kind, payload[:cut])


def test_a_length_out_of_all_bounds_allocates_nothing() -> None:
    with pytest.raises(RequestError, match="cut short"):
        cdr.decode("std_msgs/msg/Float64MultiArray", cdr.HEADER + bytes(4) + bytes(4) + b"\xff\xff\xff\xff")
    with pytest.raises(RequestError, match="claims"):
        cdr.decode(
            "diagnostic_msgs/msg/DiagnosticArray",
            cdr.encode("std_msgs/msg/Header", odometry("", "")["header"]) + b"\0" * 3 + b"\xff" * 4,
        )


def test_errors_say_what_is_wrong() -> None:
    with pytest.raises(RequestError, match="little endian"):
        cdr.decode("std_msgs/msg/Bool", b"\0\0\0\0\1")
    with pytest.raises(RequestError, match="follow its end"):
        cdr.decode("std_msgs/msg/Bool", cdr.HEADER + b"\1" + bytes(8))
    with pytest.raises(RequestError, match="UTF-8"):
        cdr.decode("std_msgs/msg/String", cdr.HEADER + b"\2\0\0\0\xff\0")
    with pytest.raises(RequestError, match="NUL"):
        cdr.decode("std_msgs/msg/String", cdr.HEADER + b"\2\0\0\0ab")
    with pytest.raises(RequestError, match="spoken"):
        cdr.decode("std_msgs/msg/Boll", cdr.HEADER + b"\1")
