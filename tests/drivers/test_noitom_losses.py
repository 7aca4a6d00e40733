"""The suit's driver against scripted senders: loss, garbage, and what is refused."""

from __future__ import annotations

import contextlib
import itertools
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.noitom import MS, START, Make, Sender, binary, numbers, opened, steady, suit, text
from helpers.wait import until
from pydantic import ValidationError

from srl.drivers.noitom import NoitomConfig
from srl.drivers.noitom.protocol import encode_binary
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

# -- loss and garbage


def test_garbage_is_counted_and_got_over() -> None:
    sender, device = opened()
    now = steady(sender, device, 5, START)
    sender.give(bytes(range(256)) * 3)
    broken = numbers()
    broken[7] = np.nan
    sender.give(encode_binary(broken, sender.number))
    device.read(now + MS)
    assert device.health.resyncs == 1
    assert device.health.errors == 1
    steady(sender, device, 1, now)
    assert device.health.stamp > now


def test_a_stream_that_becomes_something_else_is_looked_at_anew() -> None:
    sender, device = opened()
    steady(sender, device, 5, START)
    sender.make = text
    with pytest.raises(DeviceLostError, match="no frame any more"):
        steady(sender, device, 200, START)
    device.close()
    with sender.sending():
        device.open()
    assert device.health.message.startswith("text")
    assert device.health.reconnects == 1


def test_a_hung_up_link_is_a_lost_device() -> None:
    sender, device = opened()
    sender.close()
    with pytest.raises(DeviceLostError):
        until(lambda: False, lambda: device.read(time.monotonic_ns()))
    assert not device.health.connected


def test_reading_before_opening_and_closing_twice() -> None:
    _, device = opened()
    device.close()
    device.close()
    with pytest.raises(DeviceLostError, match="isn't open"):
        device.read(0)
    device.write(0)
    assert device.fileno() is None


# -- what is refused


def refusal(make: Make | None, **options: object) -> DeviceError:
    sender = Sender(make or binary)
    device = suit(sender.url, **options)
    with pytest.raises(DeviceError) as caught, sender.sending() if make else contextlib.nullcontext():
        device.open()
    assert not device.health.connected
    return caught.value


def test_silence_is_refused_with_the_box_to_tick() -> None:
    error = refusal(None)
    assert "nothing came" in error.problem
    assert "Tick 'BVH'" in error.remedy


@pytest.mark.slow
def test_the_wrong_avatar_is_refused() -> None:
    error = refusal(binary, avatar=3)
    assert "no frame of avatar 3 came" in error.problem
    assert "avatar" in error.remedy


CALC = bytes.fromhex("ff8803000001b203000000000000436861723030") + bytes(42) + b"\xff\x99" + bytes(946 * 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "shown"),
    [(CALC, "ff 88 03"), (b"GET / HTTP/1.1\r\n\r\n", "GET / HTTP"), (b"0 Char00 1.0 2.0 3.0 ||\r\n", "0 Char00 1.0")],
)
def test_another_stream_is_refused_and_shown(what: bytes, shown: str) -> None:
    error = refusal(lambda _: what)
    assert f"got '{shown}" in error.problem
    assert "old header" in error.remedy


def test_a_stream_that_is_too_slow_is_refused() -> None:
    sender = Sender()
    device = suit(sender.url)
    with sender.sending(0.4), pytest.raises(DeviceError, match="times a second"):
        device.open()


def test_datagrams_are_taken_at_the_port_that_the_software_sends_to() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as up,
    ):
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        device = suit(f"udp://:{port}")
        with pytest.raises(DeviceError, match=f"port {port} is taken"):
            device.open()
        probe.close()
        end = threading.Event()

        def send() -> None:
            for k in itertools.count():
                if end.wait(0.01):
                    return
                up.sendto(binary(k), ("127.0.0.1", port))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            device.open()
        finally:
            end.set()
            thread.join()
        up.sendto(binary(1000), ("127.0.0.1", port))
        until(lambda: device.health.frames, lambda: device.read(time.monotonic_ns()))
        device.close()


def test_options_are_checked() -> None:
    for wrong in ({"order": "XYX"}, {"avatar": -1}, {"skeleton": "vicon"}, {"scale": 0}, {"rate": 3}):
        with pytest.raises(ValidationError):
            NoitomConfig.model_validate({"port": "tcp://h:7001"} | wrong)


def test_its_page_names_every_option() -> None:
    page = (Path(__file__).parents[2] / "docs/devices/noitom.md").read_text()
    for option in NoitomConfig.model_fields:
        assert f"`{option}`" in page
