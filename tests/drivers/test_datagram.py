"""Datagram links over loopback."""

from __future__ import annotations

import socket

import pytest

from srl.drivers.datagram import open_datagrams
from srl.runtime.contracts.errors import DeviceError, DeviceLostError


def test_datagrams_come_whole_and_in_order() -> None:
    end = open_datagrams("udp://127.0.0.1:0", place="end", listen=True)
    device = open_datagrams(f"udp://127.0.0.1:{end.local[1]}", place="device")
    assert end.read() == []
    for k in range(300):
        assert device.write(b"%d" % k)
    found = end.read_wait(1.0)
    assert found == [b"%d" % k for k in range(256)]
    assert end.read() == [b"%d" % k for k in range(256, 300)]
    assert end.peer == device.local
    assert end.write(b"back", end.peer)
    assert device.read_wait(1.0) == [b"back"]
    end.close()
    device.write(b"x")
    with pytest.raises(DeviceLostError, match="nobody listens"):
        device.read_wait(1.0)
    device.close()
    device.close()
    with pytest.raises(DeviceLostError):
        device.read()


def test_only_the_device_is_heard() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device, socket.socket(type=socket.SOCK_DGRAM) as other:
        device.bind(("127.0.0.1", 0))
        link = open_datagrams(f"udp://127.0.0.1:{device.getsockname()[1]}", place="device")
        other.sendto(b"intruder", link.local)
        device.sendto(b"own", link.local)
        assert link.read_wait(1.0) == [b"own"]
        link.close()


@pytest.mark.parametrize(
    ("url", "listen", "words"),
    [
        ("udp://host", False, "isn't udp://HOST:PORT"),
        ("udp://:5", False, "isn't udp://HOST:PORT"),
        ("tcp://a:5", True, "isn't udp://:PORT"),
        ("udp://a:99999", False, "isn't udp://HOST:PORT"),
        ("udp://a:5/x", False, "isn't udp://HOST:PORT"),
        ("udp://no.such.host.invalid:5", False, "no host is called"),
        ("udp://a\0b:5", False, "no host is called"),
        ("udp://a\0b:5", True, "no host is called"),
    ],
)
def test_a_wrong_url_is_explained(url: str, listen: bool, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        open_datagrams(url, place="device", listen=listen)


def test_a_taken_port_is_named() -> None:
    first = open_datagrams("udp://127.0.0.1:0", place="one", listen=True)
    with pytest.raises(DeviceError, match="is taken by another program"):
        open_datagrams(f"udp://127.0.0.1:{first.local[1]}", place="two", listen=True)
    first.close()
