"""The zenoh process: what is said to it and by it, expiry, and a socket that never holds the loop up."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.wait import until
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.zenoh_link import Link, Outlet, PeerConfig, wire
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.tls import TlsConfig
from srl.sim.devices.zenoh.twin import Arrival, ZenohDoor

INT64 = st.integers(-(2**63), 2**63 - 1)
KEY = "robot/command"


@given(st.integers(0, 65535), st.integers(0, 65535), INT64, INT64, st.text(max_size=60), st.binary(max_size=100))
def test_samples_there_and_back(session: int, source: int, arrived: int, stamp: int, text: str, data: bytes) -> None:
    item = wire.Sample(source, arrived, stamp, text, data)
    message = wire.sample(session, item)
    assert wire.head(message) == (b"D", session)
    assert wire.read_event(message) == item


@given(st.integers(0, 65535), st.integers(0, 2**32 - 1), INT64, INT64, INT64, st.binary(max_size=100))
def test_commands_there_and_back(outlet: int, number: int, made: int, expires: int, stamp: int, data: bytes) -> None:
    item = wire.Command(outlet, number, made, expires, stamp, data)
    assert wire.read_command(wire.command(7, item)) == item


def test_the_other_messages_there_and_back() -> None:
    assert wire.read_event(wire.taken(1, 5)) == wire.Taken(5)
    assert wire.read_event(wire.token(1, 2, True)) == wire.Token(2, True)
    assert wire.read_event(wire.token(1, 2, False)) == wire.Token(2, False)
    assert wire.read_event(wire.answer(1, "a/b", b"xy")) == wire.Answer("a/b", b"xy")
    assert wire.read_event(wire.simple(b"F", 1, "no")) == wire.Words(b"F", "no")
    assert wire.body(wire.simple(b"Q", 1, {"key": "a"})) == {"key": "a"}


@pytest.fixture
def door() -> Iterator[ZenohDoor]:
    made = ZenohDoor("router", [KEY], [], [])
    made.open()
    yield made
    made.close()


def opened(door: ZenohDoor) -> Link:
    link = Link("test")
    link.open(PeerConfig(port=door.address), ["robot/state"], [Outlet(KEY, "", b"stop")], [])
    return link


def taken(door: ZenohDoor, count: int) -> list[Arrival]:
    """At least `count` samples."""
    found: list[Arrival] = []
    until(lambda: len(found) >= count, lambda: found.extend(door.read()))
    return found


def subscribed(link: Link, door: ZenohDoor, payload: bytes) -> list[wire.Event]:
    """Writes until the first of it arrives: then the subscription is known."""
    return until(lambda: link.wait(0.02), lambda: door.write("robot/state", payload), what="the subscription")


def published(link: Link, payload: bytes, lasts: float) -> None:
    """Hands a command over, once the one before was taken."""
    until(lambda: link.publish(0, payload, time.monotonic_ns() + round(lasts * 1e9)), link.read)


def test_a_command_and_the_stop_that_follows(door: ZenohDoor) -> None:
    link = opened(door)
    published(link, b"go", 1.0)  # long enough for a machine that is held up
    payloads = [arrival.payload for arrival in taken(door, 21)]
    assert payloads == [b"go"] + [b"stop"] * 20
    time.sleep(0.2)  # in which nothing more may come
    assert door.read() == []  # then the peer's own time-out has the word
    link.close()


def test_nothing_is_published_before_the_first_command(door: ZenohDoor) -> None:
    link = opened(door)
    link.stop()
    link.close()
    time.sleep(0.3)  # in which nothing may come
    assert door.read() == []


def test_a_process_that_hung_drops_what_has_expired(door: ZenohDoor) -> None:
    link = opened(door)
    pid = link.pid()
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        assert link.publish(0, b"old", time.monotonic_ns() + 50_000_000)
        assert not link.publish(0, b"older", time.monotonic_ns() + 50_000_000)  # at most one is on its way
        time.sleep(0.1)  # past what both last
    finally:
        os.kill(pid, signal.SIGCONT)
    published(link, b"new", 5.0)
    assert taken(door, 1)[0].payload == b"new"
    link.close()


def test_a_session_gets_nothing_of_the_one_before(door: ZenohDoor) -> None:
    link = opened(door)
    subscribed(link, door, b"one")
    for _ in range(50):
        door.write("robot/state", b"one")
    time.sleep(0.2)  # the process hands them to a loop that doesn't read
    first = link.pid()
    link.close()
    link.open(PeerConfig(port=door.address), ["robot/state"], [], [])
    assert link.pid() == first  # the process stays
    assert link.read() == []
    events = subscribed(link, door, b"two")
    assert {e.payload for e in events if isinstance(e, wire.Sample)} == {b"two"}
    link.close()


@pytest.mark.slow
def test_a_loop_that_does_not_read_costs_nobody_anything(door: ZenohDoor) -> None:
    link = opened(door)
    subscribed(link, door, bytes(1000))
    for _ in range(3000):  # more than the socket holds
        door.write("robot/state", bytes(1000))
    while events := link.read():
        assert len(events) <= 256
    published(link, b"go", 5.0)
    assert taken(door, 1)[0].payload == b"go"
    link.close()


def test_nobody_there_is_said(door: ZenohDoor) -> None:
    address = door.address
    door.close()
    link = Link("test")
    with pytest.raises(DeviceError, match="no connection"):
        link.open(PeerConfig(port=address), [], [], [], timeout=0.3)
    assert link.fileno() is None
    with pytest.raises(DeviceLostError):
        link.read()
    link.close()


@pytest.mark.slow
def test_a_command_taken_while_the_socket_was_full_holds_up_none_after_it(door: ZenohDoor) -> None:
    link = opened(door)
    subscribed(link, door, bytes(1000))
    for _ in range(3000):  # the loop hangs between read and write
        door.write("robot/state", bytes(1000))
    time.sleep(0.5)  # the process hands them over until its socket is full
    assert link.publish(0, b"one", time.monotonic_ns() + 10**10)
    assert [arrival.payload for arrival in taken(door, 1)] == [b"one"]
    published(link, b"two", 5.0)
    assert taken(door, 1)[0].payload == b"two"
    link.close()


@pytest.mark.slow
def test_a_process_that_hangs_is_replaced(door: ZenohDoor, monkeypatch: pytest.MonkeyPatch) -> None:
    link = opened(door)
    hung = link.pid()
    assert hung is not None
    os.kill(hung, signal.SIGSTOP)
    link.close()
    with monkeypatch.context() as patch:
        patch.setattr("srl.drivers.zenoh_link.link.START", 0.2)
        with pytest.raises(DeviceError, match="hangs"):
            link.open(PeerConfig(port=door.address), [], [], [], timeout=0.2)
    with pytest.raises(ProcessLookupError):
        os.kill(hung, 0)
    link.open(PeerConfig(port=door.address), [], [], [])
    assert link.pid() not in (None, hung)
    link.close()


def test_what_comes_while_an_answer_is_awaited_is_read_next(door: ZenohDoor) -> None:
    """An emergency stop, say, which the robot reports once."""
    link = opened(door)
    subscribed(link, door, b"before")
    door.write("robot/state", b"pressed")
    assert link.tokens("robot/*", timeout=0.5) == []
    last = [event for event in link.read() if isinstance(event, wire.Sample)]
    assert last[-1].payload == b"pressed"
    assert link.read() == []
    link.close()


@pytest.mark.parametrize("name", ["ca", "certificate", "key"])
def test_a_certificate_that_is_not_there_is_named(tmp_path: Path, name: str) -> None:
    paths = {each: str(tmp_path / each) for each in ("ca", "certificate", "key")}
    for path in paths.values():
        Path(path).touch()
    Path(paths[name]).unlink()
    link = Link("test")
    with pytest.raises(DeviceError, match=f"tls.{name}: '{paths[name]}' can't be read"):
        link.open(PeerConfig(port="tls://127.0.0.1:7447", tls=TlsConfig(**paths)), [], [], [])


def test_a_host_that_nobody_has_is_named() -> None:
    with pytest.raises(DeviceError, match="no host is called 'nobody'"):
        Link("test").open(PeerConfig(port="tcp://nobody:7447", unencrypted_network=True), [], [], [])
