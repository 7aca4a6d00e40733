"""CAN links over python-can's own interfaces."""

from __future__ import annotations

import os
import pty
import select

import can
import pytest
import serial
from can.interfaces.socketcan.socketcan import build_can_frame

from srl.drivers import canbus
from srl.drivers.canbus import CanLink, open_can
from srl.runtime.contracts.errors import DeviceError, DeviceLostError


@pytest.mark.parametrize("url", ["can://virtual/one", "can://udp_multicast/239.74.163.77?port={port}"])
def test_frames_go_both_ways(url: str) -> None:
    url = url.format(port=20000 + os.getpid() % 10000)  # its own, beside another suite on this host
    one, other = open_can(url, place="one"), open_can(url, place="other")
    assert one.read() == []
    assert one.write(can.Message(arbitration_id=0x64, data=[1, 2, 3], is_extended_id=False))
    (frame,) = other.read_wait(2.0)
    assert (frame.arbitration_id, bytes(frame.data)) == (0x64, b"\x01\x02\x03")
    for k in range(20):
        assert other.write(can.Message(arbitration_id=k, data=[k], is_extended_id=False))
    found = []
    while len(found) < 20:
        new = one.read_wait(2.0)
        assert new
        found += [m.arbitration_id for m in new]  # one's own, which a multicast bus returns, aren't among them
    assert found == list(range(20))
    one.close()
    one.close()
    other.close()
    with pytest.raises(DeviceLostError, match="closed"):
        one.read()


@pytest.mark.parametrize("url", ["can://virtual/aged", "can://udp_multicast/239.74.163.79?port={port}"])
def test_a_frame_that_waited_in_the_queue_keeps_its_age(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a pause of the loop: the kernel has kept them, and says when they came."""
    url = url.format(port=20000 + os.getpid() % 10000)
    one, other = open_can(url, place="one"), open_can(url, place="other")
    other.write(can.Message(arbitration_id=1, data=[1], is_extended_id=False))
    (frame,) = one.read_wait(2.0)
    now = 10_000_000_000
    fresh = one.stamp(frame, now)
    assert 0 < fresh <= now
    real = canbus.time.time
    monkeypatch.setattr(canbus.time, "time", lambda: real() + 0.7)
    assert one.stamp(frame, now) <= fresh - 690_000_000
    monkeypatch.setattr(canbus.time, "time", lambda: real() - 0.7)  # somebody has set the clock
    assert one.stamp(frame, now) == now
    one.close()
    other.close()


def test_what_an_interface_without_times_had_in_its_queue_counts_as_old_as_the_pause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    link = CanLink("can://slcan/none", "one", can.Bus(interface="virtual", channel="untimed"), "slcan")
    frame, now, clock = can.Message(arbitration_id=1), 10_000_000_000, [50.0]
    monkeypatch.setattr(canbus.time, "monotonic", lambda: clock[0])
    for pause, age in ((0.01, 0), (0.01, 0), (0.3, 300_000_000), (0.01, 0)):
        clock[0] += pause
        link.read()
        assert now - link.stamp(frame, now) == pytest.approx(age, abs=100)
    link.close()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("can0", "isn't can://INTERFACE/CHANNEL"),
        ("can://socketcan", "isn't can://INTERFACE/CHANNEL"),
        ("can://[::1", "isn't can://INTERFACE/CHANNEL"),
        ("can://kvaser/0", "can't be opened"),  # without its library python-can raises a NameError
        ("can://udp_multicast/239.74.163.78?hop_limit=x", "can't be opened"),
        ("can://soketcan/can0", "no interface 'soketcan'"),
        ("can://socketcan/can77", "can't be opened"),
        ("can://slcan//dev/no-such-port?bitrate=1000000", "can't be opened"),
    ],
)
def test_a_wrong_url_is_explained(url: str, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        open_can(url, place="ft")


def test_a_serial_adapter_is_never_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter, line = pty.openpty()
    link = open_can(f"can://slcan/{os.ttyname(line)}?bitrate=1000000&sleep_after_open=0", place="ft")

    def wait(_: object) -> None:
        raise AssertionError("waits until the last byte has left")

    monkeypatch.setattr(serial.Serial, "flush", wait)
    assert link.write(can.Message(arbitration_id=0x64, data=[1, 2], is_extended_id=False))
    seen = b""
    while not seen.endswith(b"t06420102\r"):
        assert select.select([adapter], [], [], 10)[0], seen
        seen += os.read(adapter, 1000)
    link.close()
    os.close(adapter)
    os.close(line)


@pytest.mark.parametrize(("id", "extended"), [(0x18, False), (0x2918, True)])
def test_a_stop_frame_is_sent_by_a_plain_write_of_another_process(id: int, extended: bool) -> None:
    url = f"can://udp_multicast/239.74.163.78?port={20000 + os.getpid() % 10000}&hop_limit=0"
    one, other = open_can(url, place="one"), open_can(url, place="other")
    frame = can.Message(arbitration_id=id, data=[0xFF] * 7 + [0xFD], is_extended_id=extended)
    descriptor = one.stop_fileno()
    assert descriptor is not None
    held = os.dup(descriptor)  # as the supervisor does
    one.close()
    assert os.write(held, one.stop_frame(frame)) > 0
    (seen,) = other.read_wait(2.0)
    assert (seen.arbitration_id, seen.is_extended_id, bytes(seen.data)) == (id, extended, bytes(frame.data))
    os.close(held)
    other.close()


def test_a_stop_frame_has_the_form_that_its_interface_takes() -> None:
    adapter, line = pty.openpty()
    slcan = open_can(f"can://slcan/{os.ttyname(line)}?bitrate=1000000&sleep_after_open=0", place="one")
    short = can.Message(arbitration_id=0x18, data=[1, 0xFD], is_extended_id=False)
    long = can.Message(arbitration_id=0x801, data=[1, 0xFD], is_extended_id=True)
    assert slcan.stop_frame(short) == b"\rt018201FD\r"
    assert slcan.stop_frame(long) == b"\rT00000801201FD\r"
    assert slcan.stop_fileno() is not None
    slcan.close()
    assert slcan.stop_fileno() is None
    os.close(adapter)
    os.close(line)
    virtual = open_can("can://virtual/stops", place="one")
    assert virtual.stop_fileno() is None
    assert virtual.stop_frame(short) == b""
    # Linux' struct can_frame, as python-can itself makes it, which can't open such a socket here.
    socketcan = CanLink("can://socketcan/can0", "one", can.Bus("stops", interface="virtual"), "socketcan")
    for message in (short, long):
        ours, theirs = socketcan.stop_frame(message), build_can_frame(message)
        assert (ours[:7], len(ours), ours[8:]) == (theirs[:7], 16, theirs[8:])  # byte 7 speaks of lengths above 8
    socketcan.close()
    virtual.close()


def test_bus_off_is_a_loss_with_its_remedy() -> None:
    link, wire = open_can("can://virtual/off", place="arm"), can.Bus("off", interface="virtual")
    wire.send(can.Message(is_error_frame=True, arbitration_id=0x04, data=[0, 8]))  # error passive
    assert link.read() == []
    wire.send(can.Message(is_error_frame=True, arbitration_id=0x40))
    with pytest.raises(DeviceLostError, match="bus-off"):
        link.read()
    link.close()
    wire.shutdown()
