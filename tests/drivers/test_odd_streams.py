"""Streams that are well formed and odd: what nobody asked for, names, layouts, stamps that stand, encapsulations."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.background import repeating
from helpers.natnet import WANTED, motive
from helpers.natnet import opened as opened_motive
from helpers.natnet import step as step_motive
from helpers.noitom import PERIOD, START, Sender, numbers, opened, steady, suit
from helpers.shared import shared
from helpers.twin import bound
from helpers.xsens import mvn
from helpers.xsens import opened as opened_suit
from helpers.xsens import step as step_suit

from srl.drivers.base import BaseConfig, MobileBase
from srl.drivers.base import driver as base_driver
from srl.drivers.base import protocol as base_protocol
from srl.drivers.base.protocol import Odometry, OdometryReader
from srl.drivers.datagram import Datagrams
from srl.drivers.evdev import AxisInfo, Description, encode
from srl.drivers.evdev.records import EV_ABS
from srl.drivers.gamepad import Gamepad, GamepadConfig
from srl.drivers.gamepad.driver import BUTTONS, HAT, STICKS, TRIGGERS
from srl.drivers.natnet.config import NatNetConfig
from srl.drivers.natnet.model import BodyModel, Model
from srl.drivers.natnet.scene import Scene
from srl.drivers.noitom import driver as noitom_driver
from srl.drivers.noitom.protocol import encode_binary, encode_text
from srl.drivers.ur import UrConfig
from srl.drivers.ur import declaration as ur_declaration
from srl.drivers.ur.sample import Sample
from srl.drivers.xsens_mvn import driver as suit_driver
from srl.drivers.xsens_mvn.protocol import POSES, SEGMENTS, Pose, encode_poses, split
from srl.drivers.zenoh import Zenoh, ZenohConfig
from srl.drivers.zenoh.values import Values
from srl.drivers.zenoh_link import wire
from srl.runtime.contracts.errors import DeviceError, SrlError
from srl.runtime.contracts.field import Field
from srl.runtime.messages import cdr, messages
from srl.runtime.models.skeleton import bvh


def reported(work: Callable[[], object]) -> str:
    """How a device refuses or is lost while something is done; "" if it goes well."""
    try:
        work()
    except DeviceError as error:
        return str(error)
    return ""


# -- MVN: a segment without a pose

FEW = {"segments": {"chest": "T8", "arm": "RightUpperArm"}}
_POSE = struct.Struct(">i7f")
_HEAD, _ITEMS, _SIZE = 24, 11, 22  # a header's bytes; where the number of items and the payload's size stand
NONE = (0.0, 0.0, 0.0, 0.0)  # the quaternion of what isn't measured


def lamed(data: bytes, segment: int, position: tuple[float, float, float]) -> bytes:
    """A datagram of poses whose segment has no orientation; one that isn't there comes in addition."""
    datagram = split(data)
    if datagram.kind != POSES:
        return data
    item = encode_poses([Pose(segment, position, NONE)])
    items = [datagram.payload[at : at + _POSE.size] for at in range(0, len(datagram.payload), _POSE.size)]
    places = {_POSE.unpack(found)[0]: i for i, found in enumerate(items)}
    at = places.get(segment, len(items))
    items[at : at + 1] = [item]
    head = bytearray(data[:_HEAD])
    head[_ITEMS] = len(items)
    head[_SIZE:_HEAD] = (len(items) * _POSE.size).to_bytes(2, "big")
    return bytes(head) + b"".join(items)


def hand_over(monkeypatch: pytest.MonkeyPatch, change: Callable[[bytes], bytes]) -> None:
    """Every datagram is changed on its way to the driver."""
    read = Datagrams.read_from
    monkeypatch.setattr(Datagrams, "read_from", lambda link: [(change(data), peer) for data, peer in read(link)])
    monkeypatch.setattr(suit_driver, "OTHERS", 0.02)


@pytest.mark.parametrize("segment", [24, 28, SEGMENTS.index("LeftToe") + 1], ids=["prop", "finger", "not wanted"])
def test_a_segment_nobody_asked_for_spoils_no_other(segment: int, monkeypatch: pytest.MonkeyPatch) -> None:
    hand_over(monkeypatch, lambda data: lamed(data, segment, (0.0, 0.0, 0.0)))
    with mvn(FEW) as bench, opened_suit(bench, FEW) as driver:
        step_suit(bench, driver, 5)
        assert driver.state_arrays["visible"].tolist() == [1, 1]
        assert bench.now - driver.health.stamp < 50_000_000
        assert driver.health.errors == 0


def test_a_wanted_segment_without_a_pose_is_hidden_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    number = SEGMENTS.index("RightUpperArm") + 1
    hand_over(monkeypatch, lambda data: lamed(data, number, (0.0, 0.0, 0.0)))
    with mvn(FEW) as bench, opened_suit(bench, FEW) as driver:
        step_suit(bench, driver, 5)
        assert driver.state_arrays["visible"].tolist() == [1, 0]
        assert "RightUpperArm" in driver.health.message + driver.health.fault


# -- Noitom: names, decimal commas, the rotation order


def text(values: Any, name: str, comma: bool) -> bytes:
    record = encode_text(values, 0, name)
    return record.replace(b".", b",") if comma else record


@pytest.mark.parametrize(
    ("name", "comma", "word"),
    [("Char 00", False, "name"), ("Suit 1 2", False, "name"), ("Char00", True, "comma")],
)
@pytest.mark.parametrize("displacement", [True, False])
def test_a_record_of_another_form_is_read_right_or_refused_with_its_remedy(
    name: str, comma: bool, word: str, displacement: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = numbers(1.0, displacement)
    values[6:] += 1.2345  # every number has a fraction that doesn't begin with 0
    values[:6] = 1.5, 95.5, 2.5, 10.5, 20.5, 30.5
    sender = Sender(lambda _: text(values, name, comma))
    device = suit(sender.url)
    monkeypatch.setattr(noitom_driver, "FIRST", 0.3)
    with contextlib.closing(sender):
        with sender.sending():
            refused = reported(device.open)
        if refused:
            assert word in refused
            assert "old header" not in refused
            return
        device.read(START)
        steady(sender, device, 3, START)
        np.testing.assert_allclose(device.state_arrays["translation"][0], [0.015, 0.955, 0.025], atol=1e-6)
        device.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "order", "reported"),
    [
        ("fullbody_xyz", "XYZ", False),
        ("fullbody_xyz", "YXZ", True),
        ("fullbody_walk_yxz", "YXZ", False),
        ("fullbody_walk_yxz", "XYZ", True),
    ],
)
def test_an_order_that_lifts_a_walking_person_off_the_floor_is_told(file: str, order: str, reported: bool) -> None:
    frames = bvh.read(shared(f"data/axis_neuron_bvh/{file}.bvh")).frames
    sender, device = opened(lambda number: encode_binary(frames[number % len(frames)], number), order=order)
    now, output = START, False
    for _ in range(2 * len(frames)):
        now += PERIOD
        sender.send()
        device.read(now)
        output |= "order" in device.health.message + device.health.fault
    assert output == reported


# -- NatNet: two assets of one name


def body(name: str, number: int) -> BodyModel:
    return BodyModel(name, number, -1, (0.0, 0.0, 0.0), ())


TWINS = {
    "two bodies": Model({}, (body("wrist", 3), body("wrist", 7), body("tool", 5)), ()),
    "body and skeleton": Model({}, (body("wrist", 3), body("tool", 5)), (("wrist", 7, (body("Hip", 1),)),)),
}


@pytest.mark.parametrize("model", TWINS.values(), ids=TWINS.keys())
def test_two_assets_of_a_wanted_name_are_refused(model: Model) -> None:
    wanted = {"port": "udp://127.0.0.1:1510", "segments": {"hand": "wrist", "tool": "tool"}}
    with pytest.raises((ValueError, SrlError), match=r"(?=.*wrist)(?=.*\b3\b)(?=.*\b7\b)"):
        Scene(NatNetConfig.model_validate(wanted)).take(model)


@pytest.mark.parametrize("model", TWINS.values(), ids=TWINS.keys())
def test_two_assets_of_a_name_nobody_asked_for_are_let_be(model: Model) -> None:
    scene = Scene(NatNetConfig.model_validate({"port": "udp://127.0.0.1:1510", "segments": {"tool": "tool"}}))
    scene.take(model)
    assert scene.missing == []


def test_a_motive_with_two_bodies_of_a_name_isn_t_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second appears in the definitions that the driver gets; its number is free."""
    subjects = Model.subjects

    def doubled(model: Model) -> Any:
        found = subjects(model)
        return (*found, found[0]._replace(id=found[0].id + 40))

    monkeypatch.setattr(Model, "subjects", doubled)
    with motive() as bench, pytest.raises(DeviceError, match=r"Drill"), opened_motive(bench, WANTED) as driver:
        step_motive(bench, driver)


# -- a stamp that stands still


class Wire:
    """In place of a link to zenoh: gives what a test has put in."""

    untaken = False

    def __init__(self) -> None:
        self.waiting: list[wire.Event] = []

    def put(self, payload: bytes, encoding: str = "", stamp: int = -1) -> None:
        self.waiting.append(wire.Sample(0, time.monotonic_ns(), stamp, encoding, payload))

    def open(self, *_: object) -> None: ...

    def close(self) -> None: ...

    def tokens(self, _: str) -> list[str]:
        return []

    def read(self) -> list[wire.Event]:
        found, self.waiting = self.waiting, []
        return found

    def wait(self, _: float) -> list[wire.Event]:
        return self.read()


def odometry(stamp: int, x: float = 0.0) -> bytes:
    return base_protocol.odometry(Odometry(stamp, "odom", "base_link", (x, 0.0, 0.0), (0.1, 0.0, 0.0)))


@pytest.mark.parametrize("stamp", [0, 1_700_000_000_000_000_000], ids=["never set", "stands"])
def test_odometry_that_comes_with_one_stamp_is_told_from_silence(stamp: int, monkeypatch: pytest.MonkeyPatch) -> None:
    base, link = MobileBase("base", BaseConfig(port="tcp://127.0.0.1:1")), Wire()
    bound(base)
    base._link = link  # type: ignore[assignment]
    link.put(odometry(stamp))

    def run() -> None:
        base.open()
        monkeypatch.setattr(base_driver, "SILENT", 1)  # ns
        for i in range(20):
            link.put(odometry(stamp, 0.01 * i))
            base.read(time.monotonic_ns())

    lost = reported(run)
    assert "stamp" in lost
    assert "no odometry" not in lost


def test_a_signal_that_comes_with_one_stamp_is_told_from_silence() -> None:
    entry = {"key": "robot/joints", "shape": [1], "unit": "rad", "type": messages.JOINT_STATE}
    options = {"port": "tcp://127.0.0.1:1", "signals": {"position": entry}, "silence": 0.2}
    device, link = Zenoh("remote", ZenohConfig.model_validate(options)), Wire()
    bound(device)
    device._link = link  # type: ignore[assignment]

    def joint(stamp: int) -> bytes:
        header = {"stamp": {"sec": stamp, "nanosec": 0}, "frame_id": ""}
        return cdr.encode(
            messages.JOINT_STATE,
            {"header": header, "name": ["a"], "position": [1.0], "velocity": [], "effort": []},
        )

    for stamp in (5, 6):
        link.put(joint(stamp))
    device.open()
    device._silence = 1  # ns

    def run() -> None:
        for _ in range(20):
            link.put(joint(6))
            device.read(time.monotonic_ns())

    assert "stamp" in reported(run)


# -- a gamepad of another layout, or one that is held


@contextmanager
def served(
    folder: Path, axes: dict[int, AxisInfo]
) -> Iterator[tuple[Gamepad, Callable[[Sequence[tuple[int, int]]], None]]]:
    """A pad with these axes, the driver on it, and how an axis (code, value) moves."""
    found = Description("Pad", "", 1, 2, 3, frozenset(BUTTONS.values()), frozenset(), axes)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "pad"))
        listener.listen()
        listener.settimeout(5.0)
        pad = Gamepad("pad", GamepadConfig(port=str(folder / "pad")))
        bound(pad)
        ends: list[socket.socket] = []

        def greet() -> None:
            if not ends:
                ends.append(listener.accept()[0])
                ends[0].sendall(found.to_line())

        def move(changes: Sequence[tuple[int, int]]) -> None:
            ends[0].sendall(encode(0, [(EV_ABS, code, value) for code, value in changes]))
            pad.read(1)

        try:
            with repeating(greet, 0.001):
                pad.open()
            yield pad, move
        finally:
            pad.close()
            for end in ends:
                end.close()


def x_mode(**values: int) -> dict[int, AxisInfo]:
    """The axes of a pad in X mode, at rest but for these."""
    axes = {code: AxisInfo(0, -32768, 32767) for code in STICKS}
    axes |= {code: AxisInfo(values.get(f"axis{code}", 0), 0, 255) for code in TRIGGERS}
    return axes | {code: AxisInfo(0, -1, 1) for code in HAT}


def test_a_trigger_that_is_half_pressed_at_open_commands_nothing_until_it_was_let_go(tmp_path: Path) -> None:
    def use() -> None:
        with served(tmp_path, x_mode(axis5=128)) as (pad, move):
            pad.read(1)
            assert pad.state_arrays["axes"].tolist() == [0] * 6
            assert "right_trigger" in pad.health.message
            move([(5, 140)])
            assert pad.state_arrays["axes"][5] == 0
            move([(5, 0)])
            move([(5, 255)])
            assert pad.state_arrays["axes"][5] == 1

    refused = reported(use)
    assert not refused or "trigger" in refused


def test_a_pad_whose_second_stick_is_where_triggers_are_commands_nothing(tmp_path: Path) -> None:
    """A generic HID pad: the right stick is Z and RZ, the triggers are RX and RY."""
    centred, released = AxisInfo(128, 0, 255), AxisInfo(0, 0, 255)
    axes = {0: centred, 1: centred, 2: centred, 5: centred, 3: released, 4: released}
    axes |= {code: AxisInfo(0, -1, 1) for code in HAT}

    def use() -> None:
        with served(tmp_path, axes) as (pad, _):
            pad.read(1)
            assert not pad.state_arrays["axes"].any()
            assert "trigger" in pad.health.message

    refused = reported(use)
    assert not refused or "axis" in refused or "trigger" in refused


# -- CDR: one rule for the encapsulation's options

OPTIONS = [b"\0\0", b"\0\1", b"\0\2", b"\0\3", b"\x80\0"]
"""DDS-XTypes 1.3, 7.6.3.1.2: the last two bits are the number of padding bytes; the others are reserved."""


@pytest.mark.parametrize("options", OPTIONS, ids=bytes.hex)
def test_options_of_the_encapsulation_are_no_reason_to_refuse_it_anywhere(options: bytes) -> None:
    def with_them(payload: bytes) -> bytes:
        return payload[:2] + options + payload[4:] + bytes(options[1] & 3)

    reader = OdometryReader()
    assert len(reader.feed(with_them(odometry(5)))) == 1, reader.problem
    assert base_protocol.read_bool(with_them(cdr.encode("std_msgs/msg/Bool", {"data": True}))) is True
    array = with_them(cdr.encode(messages.MULTI_ARRAY, messages.multi_array(np.array([1.0, 2.0]))))
    read = Values("x", 2, (), None, False).read(messages.MULTI_ARRAY, array)
    assert read.values.tolist() == [1, 2]
    field = Field("law.x", "setpoint", 0, (2,), "rad")
    assert messages.read_values(array, "", field, "k").tolist() == [1, 2]


# -- UR: a rotation vector whose length overflows


def test_a_rotation_vector_of_a_length_that_overflows_is_no_sample() -> None:
    sample = Sample()
    arrays = {s.name: np.zeros(s.shape) for s in ur_declaration.states(UrConfig(port="tcp://h"), "arm")}
    values = np.zeros(32)
    values[28:31] = 4e300, 1e10, 0.0
    if sample.take(b"\1" + values.astype(">f8").tobytes() + bytes(36)):
        sample.fill(arrays, ())
    assert np.isfinite(arrays["pose"]).all()
    assert np.abs(arrays["pose"]).max() <= 1
