"""The driver against a scripted server that isn't as it was, is silent, damaged, or another."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from helpers.fuzz import fuzz
from helpers.vicon_script import (
    ALL,
    ARM,
    ARM_OPTIONS,
    MS,
    WAND,
    Server,
    _names,
    frame,
    open_driver,
    pose,
    static,
    values,
)
from helpers.wait import until
from pydantic import ValidationError

from srl.drivers.transport import open_transport
from srl.drivers.vicon import Vicon, datastream, protocol
from srl.drivers.vicon.protocol import Block, packet
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.vicon import twin_blocks as encode


@pytest.fixture
def impatient(monkeypatch):
    """For what never comes: the driver waits less long."""
    monkeypatch.setattr(datastream, "GREETING", 0.1)
    monkeypatch.setattr(datastream, "FRAMES", 0.2)


@pytest.fixture
def arm():
    """A server with one arm, and the driver, open; the first frame was number 100."""
    server = Server(frame(100, poses={(1, 1): pose()}, static=static(ARM)))
    return server, open_driver(server)


# -- a stream that isn't as it was


def test_a_subject_switched_off_is_hidden_and_comes_back_under_another_number(arm):
    server, device = arm
    server.send(frame(101, poses={(2, 1): pose(1)}, static=static(WAND)))
    device.read(1000 * MS)
    np.testing.assert_array_equal(values(device, "visible"), [0, 0])
    assert "no base, link, first, second at present" in device.health.message
    server.send(frame(102, poses={(9, 1): pose(8)}, static=static(WAND, ARM._replace(id=9))))
    device.read(1010 * MS)
    assert values(device, "base.pose")[0] == pytest.approx(0.008)
    assert device.health.message == ""


def test_static_blocks_called_unchanged_are_remembered(arm):
    server, device = arm
    server.send(
        packet(
            encode.contents({1: 1, 5: 1, 9: 1}, {2}),
            encode.stream_info(200.0),
            encode.number(Block.FRAME_INFO, 101),
            encode.segments(Block.GLOBAL_SEGMENTS, 1, [1], np.full((1, 3), 7.0), np.eye(3)[None]),
        )
    )
    device.read(1000 * MS)
    assert values(device, "base.pose")[0] == pytest.approx(0.007)
    assert device.metrics()["frame_rate"] == 200.0


def test_frames_without_what_was_asked_for_are_borne(arm):
    server, device = arm
    server.send(packet(encode.number(Block.FRAME_INFO, 101)), packet(), protocol.ping(3))
    device.read(1000 * MS)
    assert device.health.stamp == -1
    assert device.health.errors == 0


def test_damaged_bytes_are_counted_and_the_next_frame_is_found(arm):
    server, device = arm
    good = frame(101, poses={(1, 1): pose(1)})
    server.send(b"noise", good[:100], frame(102, poses={(1, 1): pose(2)}))
    device.read(1000 * MS)
    assert values(device, "base.pose")[0] == pytest.approx(0.002)
    assert device.health.errors == device.health.resyncs == 1
    short = packet(
        encode.number(Block.FRAME_INFO, 103), protocol.block(Block.GLOBAL_SEGMENTS, struct.pack("<II", 1, 9))
    )
    server.send(short, packet(protocol.block(Block.SUBJECT_INFO, b"\1")))
    device.read(1010 * MS)
    assert device.health.errors == 3
    assert device.health.connected


def test_a_million_damaged_bytes_reach_no_state_that_isn_t_finite(arm):
    server, device = arm
    full = frame(
        101,
        poses={(1, 1): pose(1), (1, 2): pose(2)},
        markers=[(1, 1, 1, 2, 3)],
        spots=[(1, 2, 3)],
        latency=0.01,
        static=static(ARM),
    )
    now = 0

    def feed(chunk: bytes) -> None:
        nonlocal now
        now += MS
        server.send(chunk)
        device.read(now)
        server.link.read()
        assert device.health.stamp <= now

    fuzz(feed, full, total=1_000_000)
    assert device.health.errors > 100
    assert all(np.isfinite(array).all() for array in device.state_arrays.values())
    server.send(frame(200, static=static(ARM)))  # may end in what the noise began
    device.read(now)
    for k in range(130):
        server.send(frame(201 + k, poses={(1, 1): pose(6)}))
        device.read(now + (k + 1) * 10 * MS)
    assert device.state_arrays["base.pose"][0] == pytest.approx(0.006)
    assert device.health.stamp == pytest.approx(now + 1300 * MS, abs=10 * MS)


def test_a_frame_period_that_can_t_be_is_unknown(arm):
    server, device = arm
    for ticks in (0, -5, 1, 2**62):
        server.send(packet(protocol.block(Block.STREAM_INFO, struct.pack("<q", ticks))))
        device.read(MS)
    assert device.metrics()["frame_rate"] == 100.0


def test_a_silent_server_is_asked_again(arm):
    server, device = arm
    server.heard()
    device.read(1000 * MS)
    device.read(1990 * MS)
    assert server.heard() == []
    device.read(2001 * MS)
    assert [kind for kind, _ in server.heard()] == [Block.OBJECT_ENUMS, Block.REQUEST_FRAME]
    assert "no frames" in device.health.message
    server.send(frame(101, poses={(1, 1): pose(1)}))
    device.read(2010 * MS)
    assert device.health.message == ""


@pytest.mark.parametrize("offered", [ALL, ALL - {Block.REQUEST_NEXT_FRAME}])
def test_pulling_asks_for_one_frame_after_the_other(offered):
    server = Server(frame(100, static=static(ARM)), offered=offered)
    device = open_driver(server, **ARM_OPTIONS, mode="pull")
    expected = (
        (Block.REQUEST_NEXT_FRAME, b"\1\0\0\0") if Block.REQUEST_NEXT_FRAME in offered else (Block.REQUEST_FRAME, b"\0")
    )
    assert server.heard()[1:] == [expected]
    device.read(10 * MS)
    assert server.heard() == [expected]  # the first was answered
    device.read(20 * MS)
    assert server.heard() == []
    server.send(frame(101, poses={(1, 1): pose()}))
    device.read(30 * MS)
    assert server.heard() == [expected]


def test_a_server_that_hangs_up_is_lost_and_found_again(arm):
    server, device = arm
    server.link.close()

    def read():
        with pytest.raises(DeviceLostError, match="gone"):
            device.read(1000 * MS)

    until(lambda: not device.health.connected, read)
    frames = device.health.frames
    again = open_transport(server.url, place="server")
    again.write_all(protocol.object_enums(ALL) + frame(3, poses={(1, 1): pose()}, static=static(ARM)), 5.0)
    device.open()
    assert device.health.connected
    assert device.health.reconnects == 1
    assert device.health.frames > frames


# -- what is refused


def test_silence_is_refused(impatient):
    quiet = f"loop://vicon-{next(_names)}"
    server = open_transport(quiet, place="server")
    with pytest.raises(DeviceError, match=r"greeting, got nothing.*801"):
        Vicon("mocap", Vicon.Config(port=quiet, segments={"hand": "Hand"})).open()
    server.close()


def test_another_kind_of_server_is_refused(impatient):
    url = f"loop://vicon-{next(_names)}"
    server = open_transport(url, place="server")
    server.write_all(b"SSH-2.0-OpenSSH_9.2\r\n", 1.0)
    with pytest.raises(DeviceError, match=r"greeting, got the bytes 53 53 48 2d"):
        Vicon("mocap", Vicon.Config(port=url, segments={"hand": "Hand"})).open()


def test_a_server_without_the_blocks_is_refused():
    server = Server(offered=ALL - {Block.GLOBAL_SEGMENTS})
    with pytest.raises(DeviceError, match="doesn't offer GLOBAL_SEGMENTS"):
        open_driver(server, segments={"hand": "Hand"})


def test_a_server_that_isn_t_live_is_refused(impatient):
    with pytest.raises(DeviceError, match=r"sends no frames\. Go live"):
        open_driver(Server(), segments={"hand": "Hand"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"segments": {"hand": "arm"}}, r"no subject 'arm'\. Correct 'segments: \{hand: arm\}'.*Did you mean 'Arm'"),
        ({"segments": {"hand": "Arm/Link2"}}, r"'Arm' has no segment 'Link2'.*Link1'\? Known: Base, Link1"),
        ({"markers": {"tip": "Arm/X"}}, r"'Arm' has no marker 'X'.*Known: M1, M2"),
        ({"markers": {"tip": "Leg/X"}}, r"no subject 'Leg'.*Known: Arm, Wand"),
        ({"segments": {"hand": "Arm"}, "rate": 250}, r"captures 100 frames a second, the profile needs 250.*rate: 100"),
    ],
)
def test_what_isn_t_there_is_refused_with_what_is(options, message, impatient):
    server = Server(frame(1, poses={(1, 1): pose()}, static=static(ARM, WAND)))
    with pytest.raises(DeviceError, match=message):
        open_driver(server, **options)


def test_a_server_without_subjects_says_so(impatient):
    with pytest.raises(DeviceError, match=r"no subject 'Hand'.*Known: none"):
        open_driver(Server(frame(1, static=static())), segments={"hand": "Hand"})


def test_a_long_list_of_subjects_is_cut(impatient):
    many = [WAND._replace(id=i, name=f"S{i:02}") for i in range(1, 60)]
    with pytest.raises(DeviceError, match=r"There are 59: S01, .*S20, \.\.\."):
        open_driver(Server(frame(1, static=static(*many))), segments={"hand": "Hand"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "at least one"),
        ({"segments": {"Hand": "H"}}, "can't be a name"),
        ({"segments": {"pose": "H"}}, "can't be a name"),
        ({"segments": {"a": "H/B/C"}}, "isn't SUBJECT/SEGMENT"),
        ({"segments": {"a": ""}}, "isn't SUBJECT/SEGMENT"),
        ({"markers": {"a": "H"}}, "isn't SUBJECT/MARKER"),
        ({"segments": {"a": "H"}, "markers": {"a": "H/M"}}, "a segment and a marker"),
        ({"segments": {"a": "H"}, "required": ["b"]}, "'b' under required"),
        ({"port": "udp://:51001", "segments": {"a": "H/S"}}, "whole objects only"),
        ({"port": "udp://:51001", "markers": {"a": "H/M"}}, "no markers"),
    ],
)
def test_options_that_make_no_sense_are_errors(options, message):
    with pytest.raises(ValidationError, match=message):
        Vicon.Config.model_validate({"port": "tcp://h:801"} | options)
