"""Numbers by UDP: JSON and OSC, what is a sample and what isn't, and another's OSC library."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.wait import until
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.drivers.udp_messages import UdpMessages, UdpMessagesConfig
from srl.drivers.udp_messages.protocol import json_message, messages, of_json, of_osc, osc_message
from srl.drivers.udp_messages.sender_clock import SenderClock
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.shared.sockets import free_port
from srl.testing import bound

TIPS = {"tips": {"elements": {"thumb": "hand.tips.0.x", "index": "hand.tips.1.x"}, "unit": "m", "gain": 0.001}}
PRESS = {"press": {"elements": {"toe": "/foot 1", "heel": "/foot 2"}, "unit": "1"},
         "tilt": {"elements": {"roll": "/tilt"}, "unit": "rad"}}  # fmt: skip
# Of the OSC 1.0 specification's examples: a frequency, and a message with several types.
FREQUENCY = bytes.fromhex("2f6f7363 696c6c61 746f722f 342f6672 65717565 6e637900 2c660000 43dc0000")
MIXED = bytes.fromhex("2f666f6f 00000000 2c696973 66660000 000003e8 ffffffff 68656c6c 6f000000 3f9df3b6 40b5b22d")


def config(**changes: Any) -> UdpMessagesConfig:
    return UdpMessagesConfig.model_validate({"port": "udp://127.0.0.1:0", "signals": TIPS} | changes)


def test_the_specifications_examples_are_read() -> None:
    assert messages(FREQUENCY) == [("/oscillator/4/frequency", [440.0])]
    ((address, arguments),) = messages(MIXED)
    assert address == "/foo"
    assert arguments == [1000, -1, None, pytest.approx(1.234), pytest.approx(5.678)]
    assert of_osc(MIXED, ["/foo 4", "/foo", "/foo 3"]) == {"/foo 4": pytest.approx(1.234), "/foo": 1000}


def test_anothers_osc_library_reads_ours_and_we_read_its() -> None:
    bundle = pytest.importorskip("pythonosc.osc_bundle")
    builder = pytest.importorskip("pythonosc.osc_message_builder")
    found = bundle.OscBundle(osc_message({"/foot 1": 0.5, "/foot 2": -2.0, "/tilt": 1.5}))
    assert [(m.address, m.params) for m in found] == [("/foot", [0.5, -2.0]), ("/tilt", [1.5])]
    made = builder.OscMessageBuilder(address="/foot")
    for value in (0.25, 7, "text", True, b"blob", 3.5):
        made.add_arg(value)
    assert messages(made.build().dgram) == [("/foot", [0.25, 7, None, 1.0, None, 3.5])]


@given(st.dictionaries(st.sampled_from(["a", "b.c", "b.d.0", "b.d.2.x", "b.d.1"]), st.floats(-1e9, 1e9)))
def test_json_that_is_written_is_read(numbers: dict[str, float]) -> None:
    assert of_json(json_message(numbers), list(numbers)) == numbers


@given(data=st.one_of(st.binary(max_size=100), st.text(max_size=60).map(str.encode)))
def test_any_datagram_gives_numbers_or_is_refused(data: bytes) -> None:
    for read in (of_json, of_osc):
        try:
            assert isinstance(read(data, ["a", "/a"]), dict)
        except ValueError:
            pass


@pytest.mark.parametrize(
    "data", [b"#bundle\0" + bytes(8) + b"\0\0\0\x40/a\0\0", FREQUENCY[:-2], b"/a\0\0,z\0\0", b"no"]
)
def test_a_broken_packet_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"cut short|type|address|end"):
        of_osc(data, ["/a"])


def test_deep_and_wide_messages_are_refused() -> None:
    bundle = FREQUENCY
    for _ in range(40):
        bundle = b"#bundle\0" + bytes(8) + len(bundle).to_bytes(4, "big") + bundle
    with pytest.raises(ValueError, match="deep"):
        of_osc(bundle, ["/a"])
    with pytest.raises(ValueError, match="arguments"):
        of_osc(b"/a\0\0," + b"T" * 1002 + b"\0", ["/a"])


def test_a_number_that_is_too_large_is_none() -> None:
    assert of_json(b'{"a": 1' + b"0" * 400 + b', "b": 1e400, "c": 2}', ["a", "b", "c"]) == {"c": 2.0}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"port": "tcp://127.0.0.1:1"}, "must read udp://"), ({"sender": "phone"}, "isn't an address"),
        ({"format": "osc"}, "isn't an OSC address"),
        ({"format": "osc", "signals": PRESS, "sequence": "/n"}, "for JSON"),
        ({"signals": {}}, "at least 1"),
    ],
)  # fmt: skip
def test_options_that_dont_fit_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        config(**changes)


class Sender:
    """A program that sends, and the driver that listens."""

    def __init__(self, **changes: Any) -> None:
        self.port = free_port()
        self.driver = bound(UdpMessages("hand", config(port=f"udp://:{self.port}", start=2.0, **changes)))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.number = 0

    def send(self, x: float = 10.0, host: str = "127.0.0.1", **more: Any) -> None:
        self.number += 1
        content = {"hand": {"tips": [{"x": x}, {"x": -x}]}, "n": self.number} | more
        self.say(json.dumps(content).encode(), host)

    def say(self, data: bytes, host: str = "127.0.0.1") -> None:
        """From the sender's own socket, or from another host's."""
        if host == "127.0.0.1":
            self.socket.sendto(data, ("127.0.0.1", self.port))
            return
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
            made.bind((host, 0))
            made.sendto(data, ("127.0.0.1", self.port))

    def open(self) -> None:
        link = self.driver.connect()
        self.driver.connect = lambda: link  # type: ignore[method-assign]
        self.send()
        self.driver.open()

    def read(self) -> None:
        self.driver.read(time.monotonic_ns())

    def close(self) -> None:
        self.driver.close()
        self.socket.close()


@pytest.fixture
def sender() -> Iterator[Sender]:
    made = Sender(sequence="n")
    made.open()
    yield made
    made.close()


def taken(sender: Sender, count: int) -> None:
    health = sender.driver.health
    until(lambda: health.frames + health.errors + int(sender.driver.metrics()["strangers"]) >= count, sender.read)


def test_a_sample_is_the_state(sender: Sender) -> None:
    sender.send(25.0)
    taken(sender, 1)
    np.testing.assert_allclose(sender.driver.state_arrays["tips"], [0.025, -0.025])
    assert time.monotonic_ns() - sender.driver.health.stamp < 1e9


@pytest.mark.parametrize(
    "more", [{"hand": {"tips": []}}, {"hand": {"tips": [{"x": 1}, {"x": "2"}]}}, {"hand": {"tips": [{"x": None}]}}]
)
def test_a_message_without_all_numbers_is_none(sender: Sender, more: dict[str, Any]) -> None:
    sender.send(**more)
    taken(sender, 1)
    assert sender.driver.health.frames == 0
    assert "has no number at 'hand.tips" in sender.driver.health.message


def test_an_old_sample_doesnt_come_again(sender: Sender) -> None:
    sender.send(1.0)
    sender.send(2.0, n=1)
    sender.send(3.0, n=7)
    taken(sender, 3)
    assert (sender.driver.health.frames, sender.driver.health.errors) == (2, 1)
    assert sender.driver.metrics()["gaps"] == 4
    np.testing.assert_allclose(sender.driver.state_arrays["tips"][0], 0.003)


def test_another_host_doesnt_count(sender: Sender) -> None:
    sender.send(1.0)
    taken(sender, 1)
    sender.send(99.0, host="127.0.0.2")
    taken(sender, 2)
    assert sender.driver.metrics()["strangers"] == 1
    np.testing.assert_allclose(sender.driver.state_arrays["tips"][0], 0.001)


def test_silence_is_a_loss(sender: Sender) -> None:
    sender.send()
    taken(sender, 1)
    with pytest.raises(DeviceLostError, match="no sample for 1 s"):
        sender.driver.read(time.monotonic_ns() + 1_500_000_000)


def test_the_senders_clock_tells_how_old_a_sample_is() -> None:
    sender = Sender(time="t")
    sender.open = lambda: None  # type: ignore[method-assign]
    link = sender.driver.connect()
    sender.driver.connect = lambda: link  # type: ignore[method-assign]
    try:
        sender.send(t=100.0)
        sender.driver.open()
        now = time.monotonic_ns()
        sender.send(t=200.0)
        until(lambda: sender.driver.health.frames == 1, lambda: sender.driver.read(now), pause=0.001)
        sender.send(t=200.01)  # taken 10 ms later, and on its way for 300 ms more than the one before
        until(lambda: sender.driver.health.frames == 2, lambda: sender.driver.read(now + 310_000_000), pause=0.001)
        assert sender.driver.health.stamp == pytest.approx(now + 10_000_000, abs=1_000_000)
    finally:
        sender.close()


def test_of_osc_the_oldest_number_tells_the_age() -> None:
    """Messages come apart: one that doesn't come any more makes the whole device old, and none is taken for newer."""
    sender = Sender(format="osc", signals=PRESS)
    link = sender.driver.connect()
    sender.driver.connect = lambda: link  # type: ignore[method-assign]
    try:
        sender.say(osc_message({"/foot 1": 0.1, "/foot 2": 0.2, "/tilt": 0.3}))
        sender.driver.open()
        sender.say(osc_message({"/foot 1": 1.0, "/foot 2": 2.0}))
        sender.say(osc_message({"/other": 5.0}))
        sender.say(osc_message({"/tilt": 3.0}))
        began = time.monotonic_ns()
        until(lambda: sender.driver.health.frames == 1, lambda: sender.driver.read(began))
        np.testing.assert_allclose(sender.driver.state_arrays["press"], [1.0, 2.0])
        np.testing.assert_allclose(sender.driver.state_arrays["tilt"], [3.0])
        sender.say(osc_message({"/foot 1": 7.0, "/foot 2": 2.0}))
        later = began + 500_000_000
        until(lambda: sender.driver.health.frames == 2, lambda: sender.driver.read(later))
        assert sender.driver.health.stamp == began
    finally:
        sender.close()


def test_another_program_of_the_same_host_is_another_sender(sender: Sender) -> None:
    sender.send(1.0)
    taken(sender, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(
            json.dumps({"hand": {"tips": [{"x": 9}, {"x": 9}]}, "n": 3000}).encode(), ("127.0.0.1", sender.port)
        )
    taken(sender, 2)
    assert sender.driver.metrics()["strangers"] == 1
    np.testing.assert_allclose(sender.driver.state_arrays["tips"][0], 0.001)


def test_what_waited_on_its_way_is_as_old_as_it_is() -> None:
    """By `rate`: the stamp follows from the number, and isn't the arrival."""
    sender = Sender(rate=50.0)
    sender.open()
    began = time.monotonic_ns()
    try:
        for k in range(100):
            sender.send(float(k))
            frames = sender.driver.health.frames
            now = began + 20_000_000 * k + (400_000_000 if 60 <= k < 80 else 0)  # held for 0.4 s
            until(
                lambda frames=frames: sender.driver.health.frames > frames,
                lambda now=now: sender.driver.read(now), pause=0.0,
            )  # fmt: skip
            if k == 70:
                assert now - sender.driver.health.stamp == pytest.approx(400e6, abs=20e6)
    finally:
        sender.close()


@pytest.mark.parametrize("speed", [1000.0, 1.3, 0.0])
def test_a_clock_that_doesnt_run_in_seconds_is_a_loss(speed: float) -> None:
    clock = SenderClock()
    old = 0
    for k in range(1, 500):
        try:
            clock.stamp(5.0 + 0.02 * k * speed, 20_000_000 * k)
        except ValueError:
            old += 1  # it stands still
    assert clock.problem or old > 490
    fine = SenderClock()
    for k in range(1, 500):
        fine.stamp(5.0 + 0.02 * k * 1.0001, 20_000_000 * k + 3_000_000 * (k % 7))
    assert not fine.problem


def test_a_sequence_may_begin_anew_at_its_modulus() -> None:
    sender = Sender(sequence="n", sequence_modulus=256)
    sender.number = 253
    sender.open()
    try:
        for n in (254, 255, 0, 2):
            sender.send(float(n), n=n)
        taken(sender, 4)
        assert (sender.driver.health.frames, sender.driver.metrics()["gaps"]) == (4, 1)
    finally:
        sender.close()


def test_a_flood_is_cut_short_and_large_datagrams_arent_read(sender: Sender) -> None:
    sender.say(b'{"x": "' + b"a" * 9000 + b'"}')
    taken(sender, 1)
    assert "9009 bytes" in sender.driver.health.message
    for k in range(200):
        sender.send(float(k))
    until(lambda: sender.driver.health.frames >= 64, sender.read)
    assert sender.driver.state_arrays["tips"][0] == pytest.approx(0.199)


def test_why_it_cant_be_opened_is_said() -> None:
    sender = Sender(signals={"x": {"elements": {"a": "nothing"}, "unit": "1"}})
    link = sender.driver.connect()
    sender.driver.connect = lambda: link  # type: ignore[method-assign]
    try:
        sender.send()
        with pytest.raises(DeviceError, match="1 datagrams came, and no sample: a message has no number at 'nothing'"):
            sender.driver.open()
    finally:
        sender.close()
