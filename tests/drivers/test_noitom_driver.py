"""The suit's driver against scripted senders: which form it is, what is fresh, what is refused."""

from __future__ import annotations

import contextlib
import itertools
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers_shared import shared
from helpers_twin import bound, until
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from drivers.noitom import Noitom, NoitomConfig, driver
from drivers.noitom.protocol import encode_binary, encode_text
from drivers.noitom.skeleton import Skeleton
from drivers.pause import WATCH
from drivers.streamtime import StreamTime
from runtime.errors import DeviceError, DeviceLostError
from runtime.signals import Array
from sim.wearer import bvh

MS = 1_000_000
PERIOD = 10 * MS
START = 10**12  # ns on the loop's clock
Make = Callable[[int], bytes]


def numbers(hips: float = 0.0, displacement: bool = True) -> Array:
    """A frame's numbers: the T-pose, hips `hips` cm to the left, turned by (10, 20, 30) degrees."""
    rows = np.zeros((59, 6))
    rows[:, :3] = Skeleton("axis-neuron").offsets * 100
    rows[0] = hips, 95.5, -2.0, 10, 20, 30
    return rows.ravel() if displacement else np.concatenate([rows[0], rows[1:, 3:].ravel()])


def binary(number: int) -> bytes:
    return encode_binary(numbers(number % 1000), number)


def text(number: int) -> bytes:
    return encode_text(numbers(number % 1000))


class Sender:
    """The software: serves one client; sends by itself, in real time, only while the driver opens."""

    def __init__(self, make: Make = binary) -> None:
        self.door = socket.create_server(("127.0.0.1", 0))
        self.door.settimeout(0)
        self.url = f"tcp://127.0.0.1:{self.door.getsockname()[1]}"
        self.client: socket.socket | None = None
        self.make, self.number = make, 100

    def give(self, data: bytes) -> None:
        """Sends bytes to the client, the newest that has come."""
        with contextlib.suppress(BlockingIOError):
            self.client, _ = self.door.accept()
            self.client.settimeout(5.0)
            self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self.client is not None:
            with contextlib.suppress(ConnectionError):
                self.client.sendall(data)

    def send(self, count: int = 1, skip: int = 0) -> None:
        """The next frames, after some that get lost."""
        self.number += skip
        for _ in range(count):
            self.give(self.make(self.number))
            self.number += 1

    def close(self) -> None:
        for end in (self.client, self.door):
            if end is not None:
                end.close()

    @contextlib.contextmanager
    def sending(self, period: float = 0.01) -> Iterator[None]:
        end = threading.Event()

        def run() -> None:
            while not end.wait(period):
                self.send()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            end.set()
            thread.join()


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """For what never comes: the driver waits less long."""
    monkeypatch.setattr(driver, "FIRST", 1.0)
    monkeypatch.setattr(driver, "MEASURE", 0.2)


def suit(url: str, **options: object) -> Noitom:
    return bound(Noitom("suit", NoitomConfig.model_validate({"port": url} | options)))  # type: ignore[return-value]


def opened(make: Make = binary, **options: object) -> tuple[Sender, Noitom]:
    """A sender and the open driver, which has taken in all that was sent meanwhile."""
    sender = Sender(make)
    device = suit(sender.url, **options)
    with sender.sending():
        device.open()
    device._clock = StreamTime(
        1e9 / PERIOD, learn=True
    )  # the rate as known after a while, whatever this machine's pace
    device.read(START)
    return sender, device


# -- what is read


@pytest.mark.parametrize("make", [binary, text])
def test_binary_and_text_are_told_apart_and_read_alike(make: Make) -> None:
    sender, device = opened(make)
    assert device.health.connected
    assert device.health.message.startswith("binary" if make is binary else "text")
    sender.send()
    device.read(START)
    rotation, translation = device.state_arrays["rotation"], device.state_arrays["translation"]
    np.testing.assert_allclose(translation[0], [(sender.number - 1) % 1000 / 100, 0.955, -0.02], atol=1e-7)
    np.testing.assert_allclose(translation[1:], device.skeleton.offsets[1:], atol=1e-6)
    np.testing.assert_allclose(rotation[0], [0.95155, 0.18931, 0.03813, 0.23930], atol=1e-5)
    np.testing.assert_array_equal(rotation[1:], np.tile([1.0, 0, 0, 0], (58, 1)))


def test_without_displacements_bones_are_the_default_bodys_scaled() -> None:
    sender, device = opened(lambda number: encode_binary(numbers(displacement=False), number), scale=1.1)
    sender.send()
    device.read(START)
    translation = device.state_arrays["translation"]
    np.testing.assert_allclose(translation[1:], 1.1 * device.skeleton.offsets[1:])
    np.testing.assert_allclose(translation[0], [0, 0.955, -0.02], atol=1e-7)


def test_the_rotation_order_is_the_profiles() -> None:
    sender, device = opened(order="ZXY")
    sender.send()
    device.read(START)
    x, y, z, w = Rotation.from_euler("ZXY", [10, 20, 30], degrees=True).as_quat()
    np.testing.assert_allclose(device.state_arrays["rotation"][0], [w, x, y, z], atol=1e-7)


def test_one_avatar_of_several() -> None:
    def both(number: int) -> bytes:
        return encode_binary(numbers(1), number, 0) + encode_binary(numbers(2), number, 1, "Char01")

    sender, device = opened(both, avatar=1)
    sender.send(3)
    device.read(START)
    assert device.state_arrays["translation"][0, 0] == pytest.approx(0.02)
    others = device.figures()["others"]
    assert isinstance(others, int)
    assert others >= 3


ORDERS = {"fullbody_walk_yxz": "YXZ", "fullbody_xyz": "XYZ", "left_arm_fingers_yxz": "YXZ"}


@pytest.mark.parametrize("name", ORDERS)
def test_real_frames_put_joints_where_an_independent_reader_puts_them(name: str) -> None:
    """The file's own numbers on the wire; the states' forward kinematics; positions that another library confirmed."""
    path = shared(f"data/axis_neuron_bvh/{name}.bvh")
    frames = json.loads(shared("data/axis_neuron_bvh/reference_fk.json").read_text())[path.name]
    file = bvh.read(path)
    sender, device = opened(order=ORDERS[name])
    ends = {joint.name: joint for joint in file.joints if joint.name.endswith("_End")}
    for frame, places in frames.items():
        values = file.frames[int(frame)]
        sender.make = lambda number, values=values: encode_binary(values, number)
        sender.send()
        device.read(START)
        rotation, translation = device.state_arrays["rotation"], device.state_arrays["translation"].copy()
        if values.size == 180:  # without displacement: the person's own bones
            translation[1:] = [file.joints[file.index(joint)].offset / 100 for joint in device.skeleton.names[1:]]
        where, turned = np.zeros((59, 3)), [Rotation.identity()] * 59
        for i, up in enumerate(device.skeleton.parents):
            own = Rotation.from_quat(rotation[i][[1, 2, 3, 0]])
            turned[i] = own if up < 0 else turned[up] * own
            where[i] = translation[i] if up < 0 else where[up] + turned[up].apply(translation[i])
        for joint, place in places.items():
            i = device.skeleton.names.index(joint.removesuffix("_End"))
            found = where[i] + (turned[i].apply(ends[joint].offset / 100) if joint in ends else 0)
            np.testing.assert_allclose(found, np.array(place) / 100, atol=2e-6, err_msg=joint)


# -- when it was taken


def steady(sender: Sender, device: Noitom, count: int, now: int) -> int:
    for _ in range(count):
        now += PERIOD
        sender.send()
        device.read(now)
    return now


@pytest.mark.parametrize("make", [binary, text])
def test_a_frame_that_waited_is_as_old_as_its_number_says(make: Make) -> None:
    sender, device = opened(make)
    now = steady(sender, device, 50, START)
    assert device.health.stamp == pytest.approx(now, abs=3 * MS)
    now += 100 * PERIOD  # the loop's pause, or the software's; now the old ones come one by one
    for _ in range(5):
        now += MS
        sender.send()
        device.read(now)
        assert now - device.health.stamp > 900 * MS
    sender.send(95)
    device.read(now)
    assert now - device.health.stamp < 40 * MS
    assert device.figures()["gaps"] == 0


@pytest.mark.parametrize("make", [binary, text])
def test_after_frames_were_lost_old_is_told_from_new_within_two_seconds(make: Make) -> None:
    sender, device = opened(make)
    now = steady(sender, device, 50, START)
    now += 300 * PERIOD
    if make is binary:  # it is numbered: nothing is in doubt
        sender.send(skip=300)
        device.read(now := now + PERIOD)
        assert now - device.health.stamp < 40 * MS
        assert device.figures()["gaps"] == 300
    else:
        now = steady(sender, device, 10, now)
        assert now - device.health.stamp > 2900 * MS
        now = steady(sender, device, WATCH // PERIOD + 5, now)
        assert now - device.health.stamp < 40 * MS


def test_a_backlog_is_no_gap_and_its_newest_is_taken() -> None:
    sender, device = opened()
    now = steady(sender, device, 20, START)
    frames = device.health.frames
    sender.send(7)
    device.read(now + 7 * PERIOD)
    assert device.health.frames - frames == 7
    assert device.state_arrays["translation"][0, 0] == pytest.approx((sender.number - 1) / 100)
    sender.send(2, skip=3)
    device.read(now + 12 * PERIOD)
    assert device.figures()["gaps"] == 3


def test_software_that_starts_again_counts_anew() -> None:
    sender, device = opened()
    now = steady(sender, device, 50, START)
    sender.number = 0
    now = steady(sender, device, 3, now)
    assert device.health.stamp == pytest.approx(now, abs=3 * MS)


def test_without_news_nothing_changes() -> None:
    sender, device = opened()
    now = steady(sender, device, 5, START)
    stamp, before = device.health.stamp, device.state_arrays["translation"].copy()
    sender.give(binary(sender.number)[:700])  # half a frame
    device.read(now + PERIOD)
    assert device.health.stamp == stamp
    np.testing.assert_array_equal(device.state_arrays["translation"], before)
    sender.give(binary(sender.number)[700:])
    device.read(now + 2 * PERIOD)
    assert device.health.stamp > stamp
    assert device.health.errors == device.health.resyncs == 0


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


def test_the_wrong_avatar_is_refused() -> None:
    error = refusal(binary, avatar=3)
    assert "no frame of avatar 3 came" in error.problem
    assert "avatar" in error.remedy


CALC = bytes.fromhex("ff8803000001b203000000000000436861723030") + bytes(42) + b"\xff\x99" + bytes(946 * 4)


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
