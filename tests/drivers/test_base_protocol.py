"""The base's messages: golden bytes of independent encoders, properties, and garbage."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import pytest
from helpers.fuzz import fuzz, mutations, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.base import protocol, ros
from srl.drivers.base.protocol import Odometry, OdometryReader, carried, read_odometry, velocity
from srl.runtime.messages import attachment, cdr

GOLDEN_TWIST = bytes.fromhex(
    "00010000 000000000000e03f 000000000000d0bf 0000000000000000 0000000000000000 0000000000000000 000000000000f03f"
)
GOLDEN_ODOMETRY = bytes.fromhex(  # its first 112 bytes
    "0001000000f1536580b2e60e05000000 6f646f6d000000000a00000062617365 5f6c696e6b0000000000000000000000"
    "0000f03f000000000000004000000000 00000000000000000000000000000000 00000000cd3b7f669ea0e63fcd3b7f66"
    "9ea0e63ffca9f1d24d62503f00000000"
)
HASHES = {
    ("odom", "base_link"): (724, "625c87e9048425883e0e76710973dea9641fde33c0dfc5bc5f07b2714d0f31cb"),
    ("odom", "base_footprint"): (724, "9ed2dcf8b1361bb345e51d2bc27dfec2c20c61b5e48876c16086be45651da05e"),
    ("robot_odom", "robot_base_footprint"): (740, "e88796057321abd663efc44c2d2c55c9d8794aa3271c897c30e4c2a6873bb870"),
}
FINITE = st.floats(-1e6, 1e6)


def sheet_odometry(frame: str, child: str) -> bytes:
    """The sheet's example."""
    covariance = np.diag([0.001, 0.001, 1e6, 1e6, 1e6, 1000.0]).ravel()
    half = 0.7071067811865476
    message: dict[str, Any] = {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 250_000_000}, "frame_id": frame},
        "child_frame_id": child,
        "pose": {
            "pose": {
                "position": {"x": 1.0, "y": 2.0, "z": 0.0},
                "orientation": {"x": 0.0, "y": 0.0, "z": half, "w": half},
            },
            "covariance": covariance,
        },
        "twist": {
            "twist": {"linear": {"x": 0.5, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.1}},
            "covariance": covariance,
        },
    }
    return cdr.encode(protocol.ODOMETRY, message)


@pytest.mark.parametrize("frames", HASHES)
def test_the_sheets_odometry(frames: tuple[str, str]) -> None:
    payload = sheet_odometry(*frames)
    length, digest = HASHES[frames]
    assert len(payload) == length
    assert hashlib.sha256(payload).hexdigest() == digest
    found = read_odometry(payload)
    assert (found.frame, found.child_frame) == frames
    assert found.stamp == 1_700_000_000_250_000_000
    assert found.pose == pytest.approx((1.0, 2.0, math.pi / 2))
    assert found.twist == (0.5, 0.0, 0.1)


def test_the_sheets_first_bytes() -> None:
    assert sheet_odometry("odom", "base_link").startswith(GOLDEN_ODOMETRY)


def test_the_sheets_twist() -> None:
    assert velocity(protocol.TWIST, 0.5, -0.25, 1.0) == GOLDEN_TWIST
    assert protocol.read_velocity(GOLDEN_TWIST) == (0.5, -0.25, 1.0, None)


def test_the_sheets_attachment() -> None:
    sender = bytes.fromhex("df673c097090ecf7780cdb40c8f061b6")
    golden = bytes.fromhex("0100000000000000 80b21045fe9c9717 10") + sender
    assert attachment.encode(1, 1_700_000_000_250_000_000, sender) == golden
    assert attachment.stamp_of(golden) == 1_700_000_000_250_000_000
    for bad in (b"", golden[:-1], golden + b"\0", golden[:16] + b"\x11" + golden[17:], bytes(33)):
        assert attachment.stamp_of(bad) == -1


@given(FINITE, FINITE, FINITE)
def test_velocities_are_those_of_the_generic_encoder(vx: float, vy: float, wz: float) -> None:
    twist = {"linear": {"x": vx, "y": vy, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": wz}}
    assert velocity(protocol.TWIST, vx, vy, wz) == cdr.encode(protocol.TWIST, twist)
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    stamped = velocity(protocol.TWIST_STAMPED, vx, vy, wz)
    assert stamped == cdr.encode(protocol.TWIST_STAMPED, {"header": header, "twist": twist})
    filled = stamped[: protocol.STAMP_AT] + bytes([7, 0, 0, 0, 9, 0, 0, 0]) + stamped[protocol.STAMP_AT + 8 :]
    assert protocol.read_velocity(filled) == (vx, vy, wz, 7 * 10**9 + 9)


@given(
    st.integers(0, 2**31 * 10**9 - 1), st.text(max_size=20), st.text(max_size=20),
    st.tuples(FINITE, FINITE, st.floats(-3.14, 3.14)), st.tuples(FINITE, FINITE, FINITE),
)  # fmt: skip
def test_odometry_there_and_back(
    stamp: int, frame: str, child: str, pose: tuple[float, float, float], twist: tuple[float, float, float]
) -> None:
    message = Odometry(stamp, frame, child, pose, twist)
    found = read_odometry(protocol.odometry(message))
    assert (found.stamp, found.frame, found.child_frame, found.twist) == (stamp, frame, child, twist)
    assert found.pose == pytest.approx(pose, abs=1e-9)


def spoilt(at: int, value: bytes) -> bytes:
    payload = bytearray(sheet_odometry("odom", "base_link"))
    payload[at : at + len(value)] = value
    return bytes(payload)


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"", "begin"),
        (spoilt(1, b"\0"), "begin"),
        (sheet_odometry("odom", "base_link")[:-1], "bytes"),
        (sheet_odometry("odom", "base_link")[:40], "cut"),
        (sheet_odometry("odom", "base_link") + bytes(4), "bytes"),
        (spoilt(44, np.float64(np.nan).tobytes()), "finite"),
        (spoilt(388, np.float64(np.inf).tobytes()), "finite"),
        (spoilt(44 + 48, np.float64(0.1).tobytes()), "quaternion"),
        (spoilt(44 + 24, np.array([0.5, 0.5, 0.5, 0.5]).tobytes()), "vertical"),
        (spoilt(12, b"\xff\xff\xff\x7f"), "string"),
        (spoilt(8, b"\xff\xff\xff\xff"), "time"),
    ],
)
def test_what_is_wrong_is_said_and_counted(payload: bytes, why: str) -> None:
    reader = OdometryReader()
    assert reader.feed(payload) == []
    assert (reader.frames, reader.errors) == (0, 1)
    assert why in reader.problem
    assert len(reader.feed(sheet_odometry("odom", "base_link"))) == 1


def test_a_million_damaged_bytes() -> None:
    reader, good = OdometryReader(), sheet_odometry("odom", "base_link")
    fuzz(reader.feed, good)
    for damaged in mutations(good, seed=1, total=200_000):
        for message in reader.feed(damaged):  # what gets through is finite and a turn about the vertical
            assert np.isfinite([*message.pose, *message.twist]).all()
        protocol.read_bool(damaged)
        try:
            protocol.read_velocity(damaged)
        except ValueError:
            pass
    assert reader.errors > 1000
    assert size_of(reader) < 10_000
    assert reader.feed(good)


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2), st.floats(0, 0.1))
def test_a_pose_is_carried_on_as_many_small_steps_would(yaw: float, vx: float, vy: float, wz: float, s: float) -> None:
    x, y, angle, n = 1.0, -2.0, yaw, 400
    for _ in range(n):
        middle = angle + wz * s / n / 2
        x += (math.cos(middle) * vx - math.sin(middle) * vy) * s / n
        y += (math.sin(middle) * vx + math.cos(middle) * vy) * s / n
        angle += wz * s / n
    assert carried(np.array([1.0, -2.0, yaw]), np.array([vx, vy, wz]), s) == pytest.approx((x, y, angle), abs=1e-8)


def test_tokens_of_both_ways() -> None:
    topic = "robot/cmd_vel"
    token = "@/0a1b/@ros2_lv/MS/robot§cmd_vel/geometry_msgs§msg§Twist/::,10"
    assert ros.read_bridge_token(token) == (topic, protocol.TWIST)
    digest = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
    kind = "geometry_msgs::msg::dds_::Twist_"
    token = f"@ros2_lv/0/0123456789abcdef0123456789abcdef/0/10/MS/%/%/base/%robot%cmd_vel/{kind}/{digest}/::,10:,:,:,,"
    assert ros.read_rmw_token(token) == (f"0/robot/cmd_vel/{kind}/{digest}", protocol.TWIST)
    for bad in ("", "@ros2_lv/0/1/2/2/NN/%/%/node", "a/b/c"):
        assert ros.read_rmw_token(bad) is None
        assert ros.read_bridge_token(bad) is None
