from __future__ import annotations

import contextlib
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.field import Field
from srl.runtime.messages import cdr, messages

STORE = get_typestore(Stores.ROS2_HUMBLE)
STAMP = 1_700_000_000_250_000_000
FORCE = Field("client.force", "setpoint", 0, (3,), "N")
CASES = [
    (Field("glove.position", "state", 0, (3,), "rad", labels=("a", "b", "c")), "sensor_msgs/msg/JointState"),
    (Field("finger.position_command.applied", "applied", 0, (2,), "rad"), "sensor_msgs/msg/JointState"),
    (Field("arm.velocity", "state", 0, (7,), "rad/s"), "sensor_msgs/msg/JointState"),
    (Field("arm.effort", "state", 0, (7,), "N m"), "sensor_msgs/msg/JointState"),
    (Field("grip.wrench", "state", 0, (6,), "N", frame="tool"), "geometry_msgs/msg/WrenchStamped"),
    (Field("base.twist", "state", 0, (6,), "m/s", frame="base"), "geometry_msgs/msg/TwistStamped"),
    (Field("base.pose", "state", 0, (7,), "m", frame="world"), "geometry_msgs/msg/PoseStamped"),
    (Field("hand.tips", "internal", 0, (5, 3), "m", frame="palm"), "std_msgs/msg/Float64MultiArray"),
    (Field("ball.position", "truth", 0, (3,), "m", frame="world"), "std_msgs/msg/Float64MultiArray"),
    (Field("object-mapping.sphere", "internal", 0, (4,), "m"), "std_msgs/msg/Float64MultiArray"),
    (Field("pad.button", "state", 0, (), "1"), "std_msgs/msg/Float64MultiArray"),
]


@pytest.mark.parametrize(("field", "kind"), CASES, ids=[f.name for f, _ in CASES])
@settings(max_examples=20)
@given(data=st.data())
def test_a_signal_goes_there_and_back(field: Field, kind: str, data: st.DataObject) -> None:
    values = data.draw(arrays(np.float64, field.shape))
    encoder = messages.Encoder(field)
    payload = encoder.encode(values, STAMP)
    # NaN payloads differ between ways to hold a float; what is compared is bytes.
    assert encoder.kind == kind
    assert payload == cdr.encode(*messages.message_of(field, values, STAMP))
    back = messages.values_of(kind, cdr.decode(kind, payload))
    np.testing.assert_array_equal(back, values)


def test_ros_reads_what_is_meant() -> None:
    pose = Field("base.pose", "state", 0, (7,), "m", frame="world")
    payload = messages.Encoder(pose).encode(np.array([1.0, 2, 3, 0.5, -0.5, 0.25, -0.25]), STAMP)
    theirs = STORE.deserialize_cdr(payload, "geometry_msgs/msg/PoseStamped")
    q = theirs.pose.orientation
    assert (q.w, q.x, q.y, q.z) == (0.5, -0.5, 0.25, -0.25)
    assert (theirs.header.stamp.sec, theirs.header.stamp.nanosec) == (1_700_000_000, 250_000_000)
    assert (theirs.pose.position.z, theirs.header.frame_id) == (3.0, "world")
    effort = Field("arm.effort", "state", 0, (2,), "N m")
    joints = STORE.deserialize_cdr(messages.Encoder(effort).encode(np.array([4.0, 5]), 0), "sensor_msgs/msg/JointState")
    assert (joints.name, joints.position.size, joints.effort.tolist()) == (["arm_0", "arm_1"], 0, [4.0, 5.0])
    wrench = Field("grip.wrench", "state", 0, (6,), "N", frame="tool")
    theirs = STORE.deserialize_cdr(
        messages.Encoder(wrench).encode(np.arange(6.0), 0), "geometry_msgs/msg/WrenchStamped"
    )
    assert (theirs.wrench.force.y, theirs.wrench.torque.x) == (1.0, 3.0)


def test_layout_of_an_array_follows_ros() -> None:
    array = messages.multi_array(np.zeros((5, 3)))
    assert [(d["size"], d["stride"]) for d in array["layout"]["dim"]] == [(5, 15), (3, 3)]


def joints(names: list[str], position: list[float], **more: list[float]) -> bytes:
    header = {"stamp": messages.time_of(0), "frame_id": ""}
    content = {"header": header, "name": names, "position": position, "velocity": [], "effort": []} | more
    return cdr.encode(messages.JOINT_STATE, content)


@pytest.mark.parametrize("declared", ["application/cdr;sensor_msgs/msg/JointState", "zenoh/bytes", "application/cdr"])
def test_setpoint_as_joint_state(declared: str) -> None:
    field = Field("client.q", "setpoint", 0, (3,), "rad")
    assert messages.read_values(joints([], [1, 2, 3]), declared, field, "k").tolist() == [1, 2, 3]


@pytest.mark.parametrize(("unit", "part"), [("rad/s", "velocity"), ("m/s", "velocity"), ("N m", "effort")])
def test_of_a_joint_state_the_field_of_the_unit_counts(unit: str, part: str) -> None:
    """A state that is echoed back to a velocity must not turn positions into speeds."""
    field = Field("client.v", "setpoint", 0, (3,), unit)
    echoed = joints([], [1.5, -1.2, 0.3], **{part: [0.0, 0.0, 0.1]})
    assert messages.read_values(echoed, "", field, "k").tolist() == [0.0, 0.0, 0.1]
    with pytest.raises(RequestError, match=f"its field '{part}' is empty"):
        messages.read_values(joints([], [1.5, -1.2, 0.3]), "", field, "k")
    with pytest.raises(RequestError, match="a JointState has nothing in K"):
        messages.read_values(echoed, messages.encoding(messages.JOINT_STATE), replace(field, unit="K"), "k")


def test_named_joints_are_put_in_order() -> None:
    field = Field("client.q", "setpoint", 0, (2,), "rad", labels=("a", "b"))
    assert messages.read_values(joints(["b", "a"], [1, 2]), "", field, "k").tolist() == [2, 1]
    with pytest.raises(RequestError, match="the joints are b, c"):
        messages.read_values(joints(["b", "c"], [1, 2]), "", field, "k")


@pytest.mark.parametrize("payload", ["[1, 2, 3]", "[1e0, -2.5, 3]"])
def test_setpoint_as_json(payload: str) -> None:
    expected = json.loads(payload)
    assert messages.read_values(payload.encode(), messages.JSON, FORCE, "k").tolist() == expected


@pytest.mark.parametrize(
    ("payload", "output"),
    [
        (b"[1, 2]", "2 values came where the signal has 3"),
        (b"[1, 2, NaN]", "NaN or infinite"),
        (b"[1, 2, Infinity]", "NaN or infinite"),
        (b"[1, 2, 1e999]", "NaN or infinite"),
        (b"[1, 2, true]", "isn't a number"),
        (b"[1, 2, null]", "isn't a number"),
        (b'{"a": 1}', "isn't a number"),
        (b"[[1], [2, 3]]", "differ in length"),
        (b"[1, 2, 1" + b"0" * 400 + b"]", "too large"),
        (b"stop", "neither JSON nor CDR"),
        (b"\xff\xfe", "neither JSON nor CDR"),
        (b"", "neither JSON nor CDR"),
        (b"[" * 10_000, "neither JSON nor CDR"),
        (b"[" + b"1, " * 30_000 + b"1]", "has 90003 bytes"),
        (cdr.encode(messages.MULTI_ARRAY, messages.multi_array(np.array([1, np.nan, 2]))), "NaN or infinite"),
        (cdr.HEADER + b"\xff" * 40, "payload"),
    ],
)
def test_what_is_no_setpoint_is_refused(payload: bytes, output: str) -> None:
    with pytest.raises(RequestError, match=output):
        messages.read_values(payload, "", FORCE, "k")


POSE = Field("client.pose", "setpoint", 0, (7,), "m", frame="world")
ARM = Field("client.position", "setpoint", 0, (3,), "rad", labels=("a", "b", "c"))


def pose(values: list[float], frame: str) -> bytes:
    field = Field("client.pose", "setpoint", 0, (7,), "m", frame=frame)
    return cdr.encode(*messages.message_of(field, np.array(values), 0))


def test_a_pose_is_a_setpoint_in_its_own_frame_alone() -> None:
    declared, right = messages.encoding(messages.POSE), [0.1, 0.2, 0.3, 0.5, 0.5, -0.5, 0.5]
    assert messages.read_values(pose(right, "world"), declared, POSE, "k").tolist() == right
    for frame in ("", "base"):
        with pytest.raises(RequestError, match=f"frame_id is '{frame}'"):
            messages.read_values(pose(right, frame), declared, POSE, "k")
    with pytest.raises(RequestError, match="quaternion has the length 0"):
        messages.read_values(pose([0.1, 0.2, 0.3, 0, 0, 0, 0], "world"), declared, POSE, "k")
    with pytest.raises(RequestError, match="quaternion has the length 2"):
        messages.read_values(b"[0, 0, 0, 2, 0, 0, 0]", "", POSE, "k")
    with pytest.raises(RequestError, match="can't be a geometry_msgs/msg/PoseStamped"):
        messages.read_values(pose(right, "world"), declared, FORCE, "k")


def test_joints_that_are_left_out_get_the_rest_where_there_is_one() -> None:
    header = {"stamp": messages.time_of(0), "frame_id": ""}
    arrays = {"position": [7.0, 5.0], "velocity": (), "effort": ()}
    part = cdr.encode(messages.JOINT_STATE, {"header": header, "name": ["c", "a"], **arrays})
    rest, declared = np.array([1.0, 2.0, 3.0]), messages.encoding(messages.JOINT_STATE)
    assert messages.read_values(part, declared, ARM, "k", rest).tolist() == [5.0, 2.0, 7.0]
    with pytest.raises(RequestError, match="Name these: a, b, c"):
        messages.read_values(part, declared, ARM, "k")
    for names in (["c", "c"], ["c", "d"]):
        wrong = cdr.encode(messages.JOINT_STATE, {"header": header, "name": names, **arrays})
        with pytest.raises(RequestError, match="Name these: a, b, c"):
            messages.read_values(wrong, declared, ARM, "k", rest)


@given(
    st.binary(max_size=100),
    st.sampled_from(["", "application/cdr", *(messages.encoding(k) for k in cdr.TYPES)]),
)
def test_any_bytes_are_values_or_a_request_error(payload: bytes, declared: str) -> None:
    for data in (payload, cdr.HEADER + payload):
        with contextlib.suppress(RequestError):
            assert np.isfinite(messages.read_values(data, declared, FORCE, "k")).all()
