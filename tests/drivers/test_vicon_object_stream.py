"""Tracker's UDP object stream over a real socket: identified at open; hidden, frozen and overtaken objects."""

from __future__ import annotations

import contextlib
import socket
import threading
import time

import numpy as np
import pytest
from helpers.twin import bound
from helpers.wait import until

from srl.drivers.vicon import Vicon, object_stream, objects
from srl.drivers.vicon.objects import TrackedObject
from srl.runtime.contracts.errors import DeviceError

MS = 1_000_000
HAND = TrackedObject("Hand", (100.0, 200.0, 300.0, 0.0, 0.0, np.pi / 2))
TOOL = TrackedObject("Tool", (1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Tracker:
    """Sends datagrams to a port; `playing` does it in real time, 100 frames a second, in a thread."""

    def __init__(self) -> None:
        self.port = free_port()
        self.url = f"udp://127.0.0.1:{self.port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, ("127.0.0.1", self.port))

    @contextlib.contextmanager
    def playing(self, *found: TrackedObject, rate: float = 100.0, data: bytes | None = None):
        end = threading.Event()
        start = time.monotonic()

        def play() -> None:
            last = -1
            while not end.wait(0.002):
                number = int((time.monotonic() - start) * rate)
                if number > last:
                    self.send(objects.encode(number, found) if data is None else data)
                    last = number

        thread = threading.Thread(target=play)
        thread.start()
        try:
            yield
        finally:
            end.set()
            thread.join()


@pytest.fixture
def tracker():
    made = Tracker()
    yield made
    made._socket.close()


def driver_of(tracker: Tracker, **options) -> Vicon:
    options = {"segments": {"hand": "Hand", "tool": "Tool"}} | options
    device = Vicon("mocap", Vicon.Config.model_validate({"port": tracker.url} | options))
    bound(device)
    return device


@pytest.fixture
def device(tracker):
    """Open, and nothing left to read."""
    found = driver_of(tracker)
    with tracker.playing(HAND, TOOL):
        found.open()
    for now in range(5):
        found.read(now * MS)
    yield found
    found.close()


def fed(device: Vicon, now: int) -> None:
    """Reads until a datagram that was just sent has been taken."""
    frames = device.health.frames + device.health.errors
    until(lambda: device.health.frames + device.health.errors > frames, lambda: device.read(now))


def moved(item: TrackedObject, x: float) -> TrackedObject:
    return item._replace(pose=(x, *item.pose[1:]))


def test_poses_are_si_and_angles_are_of_rx_ry_rz(tracker, device):
    tracker.send(objects.encode(1000, [moved(HAND, 50.0), moved(TOOL, 2.0), TrackedObject("Other", TOOL.pose)]))
    fed(device, 1000 * MS)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(device.state_arrays["hand.pose"], [0.05, 0.2, 0.3, half, 0, 0, half])
    np.testing.assert_allclose(device.state_arrays["pose"][1, :3], [0.002, 0.002, 0.003])
    np.testing.assert_array_equal(device.state_arrays["visible"], [1, 1])
    assert device.health.stamp == 1000 * MS
    assert device.max_age == 0.1


def test_a_missing_a_zero_and_a_frozen_object_are_hidden(tracker, device):
    tracker.send(objects.encode(1000, [moved(HAND, 1.0)]))
    fed(device, 1000 * MS)
    np.testing.assert_array_equal(device.state_arrays["visible"], [1, 0])
    tracker.send(objects.encode(1001, [TrackedObject("Hand", (0.0,) * 6), moved(TOOL, 5.0)]))
    fed(device, 1010 * MS)
    np.testing.assert_array_equal(device.state_arrays["visible"], [0, 1])
    assert device.state_arrays["hand.pose"][0] == pytest.approx(0.001)
    for k in range(30):
        tracker.send(objects.encode(1002 + k, [moved(HAND, float(k)), moved(TOOL, 5.0)]))
        fed(device, (1020 + 10 * k) * MS)
        assert device.state_arrays["visible"][0] == 1
        # Its pose last changed in frame 1001.
        assert device.state_arrays["visible"][1] == (1 + k <= 10)
    assert np.isnan(device.state_arrays["tool.pose"]).all()  # hidden for longer than max_age


def test_nothing_visible_is_no_sample(tracker, device):
    tracker.send(objects.encode(1000, [moved(HAND, 1.0)]))
    fed(device, 1000 * MS)
    for k in range(3):
        tracker.send(objects.encode(1001 + k, []))
        fed(device, (1010 + 10 * k) * MS)
    assert device.health.stamp == 1000 * MS
    assert device.metrics()["hidden_frames"] == 3


def test_an_overtaken_datagram_changes_nothing(tracker, device):
    tracker.send(objects.encode(1001, [moved(HAND, 2.0)]))
    fed(device, 1000 * MS)
    tracker.send(objects.encode(1000, [moved(HAND, 1.0)]))
    fed(device, 1001 * MS)
    assert device.state_arrays["hand.pose"][0] == pytest.approx(0.002)
    assert device.health.stamp == 1000 * MS


def test_a_late_datagram_has_its_old_stamp(tracker, device):
    for k in range(5):
        tracker.send(objects.encode(1000 + k, [moved(HAND, float(k))]))
        fed(device, (1000 + 10 * k) * MS)
    tracker.send(objects.encode(1005, [moved(HAND, 9.0)]))
    fed(device, 1350 * MS)
    assert device.health.stamp == pytest.approx(1050 * MS, abs=MS)


def test_what_is_no_frame_is_counted(tracker, device):
    tracker.send(b"hello")
    fed(device, MS)
    tracker.send(objects.encode(1, [HAND, TOOL])[:60])
    fed(device, MS)
    assert device.health.errors == 2
    assert device.health.connected


def test_silence_goes_stale_and_isn_t_a_loss(tracker, device):
    for now in range(0, 10_000, 10):
        device.read(now * MS)
    assert device.health.connected


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(object_stream, "LISTEN", 0.7)


def test_silence_at_open_is_refused(tracker, impatient):
    with pytest.raises(DeviceError, match=r"expected Tracker's object stream, got nothing\. In Tracker"):
        driver_of(tracker).open()


def test_another_stream_is_refused(tracker, impatient):
    with (
        tracker.playing(data=b"\xff" * 30),
        pytest.raises(DeviceError, match=r"got 30 bytes that aren't: ff ff"),
    ):
        driver_of(tracker).open()


def test_a_missing_object_is_refused_with_those_there_are(tracker, impatient):
    device = driver_of(tracker, segments={"hand": "hand"})
    with (
        tracker.playing(HAND, TOOL),
        pytest.raises(DeviceError, match=r"no subject 'hand'.*Did you mean 'Hand'\? Known: Hand, Tool"),
    ):
        device.open()


def test_another_frame_rate_is_refused(tracker):
    device = driver_of(tracker, rate=250)
    with (
        tracker.playing(HAND, TOOL),
        pytest.raises(DeviceError, match=r"counts about \d+ frames a second, the profile says 250"),
    ):
        device.open()


def test_a_taken_port_is_refused(tracker, device):
    with pytest.raises(DeviceError, match="taken by another program"):
        driver_of(tracker).open()


def test_a_datagram_held_up_for_long_isn_t_taken_for_a_new_count(tracker, device):
    tracker.send(objects.encode(1000, [moved(HAND, 1.0)]))
    fed(device, 1000 * MS)
    for k in range(9):  # as a switch delivers what it held back, after what came since
        tracker.send(objects.encode(900 + k, [moved(HAND, 50.0)]))
        fed(device, (1001 + k) * MS)
        assert device.health.stamp == 1000 * MS
    assert device.state_arrays["hand.pose"][0] == pytest.approx(0.001)
    tracker.send(objects.encode(1001, [moved(HAND, 2.0)]))
    fed(device, 1011 * MS)
    assert device.state_arrays["hand.pose"][0] == pytest.approx(0.002)
    assert device.health.stamp == pytest.approx(1010 * MS, abs=MS)


def test_a_count_that_began_anew_is_taken_up(tracker, device):
    tracker.send(objects.encode(90_000, [moved(HAND, 1.0)]))
    fed(device, 1000 * MS)
    for k in range(object_stream.RESYNC + 1):
        tracker.send(objects.encode(k, [moved(HAND, 2.0 + k)]))
        fed(device, (2000 + 10 * k) * MS)
    assert device.health.stamp == (2000 + 10 * object_stream.RESYNC) * MS
