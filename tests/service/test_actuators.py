"""What the supervisor writes to the actuators that it holds: each frame by a write of its own, in order, to the end."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from srl.runtime.ipc.stop_slots import StopSlots
from srl.runtime.service import actuators
from srl.runtime.service.actuators import Actuators

FRAMES = tuple(bytes([i]) * 16 for i in range(1, 8))  # seven motors, each a frame as long as SocketCAN's


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def held(tmp_path: Path, reports: list[str]) -> Callable[[int], Actuators]:
    """Holds a descriptor in slot 0, whose frames are FRAMES."""
    slots = StopSlots.create(tmp_path / "slots")
    slots.write(0, FRAMES)

    def hold(descriptor: int) -> Actuators:
        found = Actuators(slots, reports.append)
        found.hold(0, "arm", os.dup(descriptor))
        return found

    return hold


def test_each_frame_is_a_message_of_its_own(held: Callable[[int], Actuators], reports: list[str]) -> None:
    ours, bus = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, bus:
        held(ours.fileno()).stop()
        assert tuple(bus.recv(100) for _ in FRAMES) == FRAMES
    assert not reports


def test_the_frames_follow_each_other_on_a_stream_that_takes_a_few_bytes_at_a_time(
    held: Callable[[int], Actuators], reports: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr(actuators.os, "write", lambda descriptor, data: write(descriptor, data[:5]))
    ours, device = socket.socketpair()
    with ours, device:
        held(ours.fileno()).stop()
        assert device.recv(1000) == b"".join(FRAMES)
    assert not reports


def test_a_bus_whose_queue_is_full_gets_the_rest_when_it_has_room(
    held: Callable[[int], Actuators], reports: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A CAN interface says ENOBUFS, where others say EAGAIN."""
    write, refusals = os.write, iter([False, False, True, True, False, True])

    def full(descriptor: int, data: bytes) -> int:
        if next(refusals, False):
            raise OSError(105, "No buffer space available")
        return write(descriptor, data)

    monkeypatch.setattr(actuators.os, "write", full)
    ours, bus = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, bus:
        held(ours.fileno()).stop()
        assert tuple(bus.recv(100) for _ in FRAMES) == FRAMES  # none twice, none left out
    assert not reports


def test_one_that_takes_nothing_is_reported_and_delays_no_other(
    held: Callable[[int], Actuators], reports: list[str], tmp_path: Path
) -> None:
    ours, bus = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    other, device = socket.socketpair()
    with ours, bus, other, device:
        ours.setblocking(False)
        try:
            while True:
                ours.send(b"x")
        except BlockingIOError:
            pass
        ours.setblocking(True)  # as some driver may have it: the supervisor doesn't rely on that
        both = held(ours.fileno())
        both._slots.write(1, (b"stop",))
        both.hold(1, "hand", os.dup(other.fileno()))
        got: list[bytes] = []
        listener = threading.Thread(target=lambda: got.append(device.recv(100)))
        listener.start()
        both.stop()
        listener.join()
        assert got == [b"stop"]
    (report,) = reports
    assert report.startswith("'arm' can't be reached for its stop: it took no bytes")


def test_frames_that_are_older_than_the_driver_allows_are_left_out_and_that_is_said(
    tmp_path: Path, reports: list[str]
) -> None:
    """An actuator that let go in the silence would be pulled back by a position of before."""
    slots = StopSlots.create(tmp_path / "slots")
    ours, bus = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, bus:
        found = Actuators(slots, reports.append)
        found.hold(0, "arm", os.dup(ours.fileno()))
        slots.write(0, FRAMES, time.monotonic_ns() - 1)
        found.stop()
        found.stop()
        bus.setblocking(False)
        with pytest.raises(BlockingIOError):
            bus.recv(100)
        assert reports == [
            "'arm' gets no stop frame: it would be pulled back to where it was if it has let go since. It goes on with "
            "its last command, or does what it does in silence"
        ]
        slots.write(0, FRAMES, time.monotonic_ns() + 10**12)
        found.stop()
        assert bus.recv(100) == FRAMES[0]
        found.close()
