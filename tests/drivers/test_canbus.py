"""CAN links over python-can's own interfaces."""

from __future__ import annotations

import os
import pty
import select

import can
import pytest
import serial

from drivers.canbus import open_can
from runtime.contracts.errors import DeviceError, DeviceLostError


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
        found += [m.arbitration_id for m in new if m.arbitration_id != 0x64]  # multicast comes back to its sender
    assert found == list(range(20))
    one.close()
    one.close()
    other.close()
    with pytest.raises(DeviceLostError, match="closed"):
        one.read()


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
