"""Values out of messages: against an independent encoder, in place or field by field, and garbage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.fuzz import fuzz
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from srl.drivers.zenoh.values import BOOL, JOY, POINT, TWIST, Values, type_of
from srl.runtime.contracts.errors import RequestError
from srl.runtime.messages import cdr, messages

STORE = get_typestore(Stores.ROS2_HUMBLE)
FLOAT = st.floats(-1e9, 1e9)


def ros(kind: str, **fields: Any) -> bytes:
    """A payload by rosbags."""
    return bytes(STORE.serialize_cdr(STORE.types[kind](**fields), kind))


def header(stamp: int = 1_700_000_000_250_000_000, frame: str = "lab") -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def joints(names: list[str], stamp: int, position: Any, velocity: Any = (), effort: Any = ()) -> bytes:
    arrays = [np.array(values, np.float64) for values in (position, velocity, effort)]
    return ros(
        messages.JOINT_STATE, header=header(stamp), name=names, position=arrays[0], velocity=arrays[1], effort=arrays[2]
    )


def xyz(kind: str, x: float, y: float, z: float) -> Any:
    return STORE.types[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)


def array(*values: float, shape: tuple[int, ...] | None = None) -> bytes:
    return cdr.encode(messages.MULTI_ARRAY, messages.multi_array(np.reshape(values, shape or len(values))))


def test_rows_of_an_array_are_followed_by_the_names_of_their_sender() -> None:
    values = Values("tips", 6, ("thumb", "index"), None, False)
    values.follow(("index", "thumb"))
    read = values.read(messages.MULTI_ARRAY, array(1, 2, 3, 4, 5, 6, shape=(2, 3))).values
    assert read.tolist() == [4, 5, 6, 1, 2, 3]
    values.follow(("thumb", "index"))
    assert values.read(messages.MULTI_ARRAY, array(1, 2, 3, 4, 5, 6, shape=(2, 3))).values.tolist() == [
        1,
        2,
        3,
        4,
        5,
        6,
    ]
    values.follow(("index", "ring"))
    with pytest.raises(RequestError, match=r"its elements are index, ring. Expected thumb, index"):
        values.read(messages.MULTI_ARRAY, array(1, 2, 3, 4, 5, 6))


def test_a_sender_that_changes_the_order_of_its_joints_is_followed() -> None:
    values = Values("position", 2, ("a", "b"), None, False)
    for k, names in enumerate((["a", "b"], ["a", "b"], ["b", "a"], ["b", "a"], ["a", "b"])):
        wanted = dict(zip(names, (k, 10 + k), strict=True))
        read = values.read(messages.JOINT_STATE, joints(names, k, list(wanted.values()))).values
        assert read.tolist() == [wanted["a"], wanted["b"]]


def test_a_pose_comes_in_the_order_of_its_labels() -> None:
    values = Values("pose", 7, ("qw", "qx", "qy", "qz", "x", "y", "z"), None, False)
    pose = {"position": dict(zip("xyz", (1.0, 2.0, 3.0), strict=True))}
    pose["orientation"] = dict(zip("wxyz", (4.0, 5.0, 6.0, 7.0), strict=True))
    message = {"header": {"stamp": messages.time_of(5), "frame_id": ""}, "pose": pose}
    for _ in range(3):  # field by field, then in place
        read = values.read(messages.POSE, cdr.encode(messages.POSE, message)).values
        assert read.tolist() == [4, 5, 6, 7, 1, 2, 3]


def test_each_message() -> None:
    types = STORE.types
    force, torque = xyz("Vector3", 1, 2, 3), xyz("Vector3", 4, 5, 6)
    twist = types[TWIST](linear=force, angular=torque)
    pose = types["geometry_msgs/msg/Pose"](
        position=xyz("Point", 1, 2, 3), orientation=types["geometry_msgs/msg/Quaternion"](x=5, y=6, z=7, w=4)
    )
    wrench = types["geometry_msgs/msg/Wrench"](force=force, torque=torque)
    six = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    for kind, payload, expected in (
        (messages.WRENCH, ros(messages.WRENCH, header=header(), wrench=wrench), six),
        (messages.TWIST, ros(messages.TWIST, header=header(), twist=twist), six),
        (messages.POSE, ros(messages.POSE, header=header(), pose=pose), [1, 2, 3, 4, 5, 6, 7]),
        (POINT, ros(POINT, header=header(), point=xyz("Point", 1, 2, 3)), [1, 2, 3]),
        (TWIST, ros(TWIST, linear=force, angular=torque), six),
        (BOOL, ros(BOOL, data=True), [1]),
        (
            JOY,
            ros(JOY, header=header(), axes=np.array([0.5, -1], np.float32), buttons=np.array([1, 0, 1], np.int32)),
            [0.5, -1],
        ),
    ):
        values = Values("any", len(expected), (), None, False)
        for _ in range(2):  # field by field, then in place
            reading = values.read(kind, payload)
            assert reading.values.tolist() == expected, kind
            assert reading.stamp == (-1 if kind in (TWIST, BOOL) else 1_700_000_000_250_000_000)


def test_buttons_of_a_joy() -> None:
    payload = ros(JOY, header=header(), axes=np.zeros(2, np.float32), buttons=np.array([1, 0, 1], np.int32))
    assert Values("panel", 3, (), "buttons", False).read(JOY, payload).values.tolist() == [1, 0, 1]


@given(
    st.lists(
        st.tuples(st.integers(1, 2**31 * 10**9 - 1), st.lists(FLOAT, min_size=3, max_size=3)), min_size=2, max_size=5
    )
)
def test_in_place_is_as_field_by_field(samples: list[tuple[int, list[float]]]) -> None:
    names = ["c", "a", "b"]
    kept = Values("position", 3, ("a", "b", "c"), None, False)
    for stamp, position in samples:
        payload = joints(names, stamp, position, [9.0, 9.0, 9.0])
        fresh = Values("position", 3, ("a", "b", "c"), None, False)
        one, other = kept.read(messages.JOINT_STATE, payload), fresh.read(messages.JOINT_STATE, payload)
        assert one.values.tolist() == other.values.tolist() == [position[1], position[2], position[0]]
        assert one.stamp == other.stamp == stamp


def test_joints_that_change_their_order_are_followed() -> None:
    values = Values("position", 2, ("a", "b"), None, False)
    for names, position in ((["a", "b"], [1.0, 2.0]), (["b", "a"], [2.0, 1.0]), (["a", "b"], [1.0, 2.0])):
        for _ in range(2):
            found = values.read(messages.JOINT_STATE, joints(names, 5, position)).values
            assert found.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("field", ["velocity", "effort"])
def test_another_field_of_a_joint_state(field: str) -> None:
    payload = joints(["a"], 5, [1.0], [2.0], [3.0])
    for values in (Values(field, 1, (), None, False), Values("other", 1, (), field, False)):
        assert values.read(messages.JOINT_STATE, payload).values == [{"velocity": 2.0, "effort": 3.0}[field]]


def test_what_does_not_fit_is_refused() -> None:
    good = joints(["a", "b"], 5, [1.0, 2.0])
    for values, kind, payload, output in (
        (Values("position", 3, (), None, False), messages.JOINT_STATE, good, "2 values"),
        (Values("position", 2, ("a", "x"), None, False), messages.JOINT_STATE, good, "its elements are a, b"),
        (Values("position", 2, (), None, False), messages.WRENCH, good, "WrenchStamped"),
        (Values("position", 2, (), None, False), "std_msgs/msg/String", good, "isn't read"),
        (Values("position", 2, (), None, False), messages.JOINT_STATE, joints(["a", "b"], 5, [1.0, np.nan]), "NaN"),
    ):
        with pytest.raises(RequestError, match=output):
            values.read(kind, payload)
    let = Values("position", 2, (), None, True)
    assert np.isnan(let.read(messages.JOINT_STATE, joints(["a", "b"], 5, [1.0, np.nan])).values[1])


@pytest.mark.parametrize("kind", [messages.JOINT_STATE, messages.MULTI_ARRAY])
def test_a_million_damaged_bytes(kind: str) -> None:
    plain = cdr.encode(messages.MULTI_ARRAY, messages.multi_array(np.arange(22.0)))
    good = joints([f"j{i}" for i in range(22)], 5, np.arange(22.0)) if kind == messages.JOINT_STATE else plain
    values = Values("position", 22, (), None, False)
    values.read(kind, good)

    def feed(payload: bytes) -> None:
        try:
            reading = values.read(kind, payload)
        except RequestError:
            return
        assert reading.values.size == 22
        assert np.isfinite(reading.values).all()

    fuzz(feed, good, total=500_000)
    assert values.read(kind, good).values.tolist() == list(range(22))


def test_encodings() -> None:
    assert type_of("application/cdr;sensor_msgs/msg/JointState") == messages.JOINT_STATE
    assert type_of("application/cdr") == type_of("zenoh/bytes") == type_of("application/json;x") == ""
