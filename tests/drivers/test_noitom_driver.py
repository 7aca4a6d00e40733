"""The suit's driver against scripted senders: which form it is, what is fresh."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from helpers.noitom import MS, PERIOD, START, Make, binary, numbers, opened, steady, suit, text
from helpers.shared import shared
from helpers.wait import until
from scipy.spatial.transform import Rotation

from srl.drivers.noitom import driver
from srl.drivers.noitom.protocol import encode_binary
from srl.drivers.streamtime import ENDURED
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.models.skeleton import bvh

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
    others = device.metrics()["others"]
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
    assert device.metrics()["gaps"] == 0


def test_after_numbered_frames_were_lost_the_next_one_is_fresh() -> None:
    sender, device = opened()
    now = steady(sender, device, 50, START)
    sender.send(skip=300)
    device.read(now := now + 301 * PERIOD)
    assert now - device.health.stamp < 40 * MS
    assert device.metrics()["gaps"] == 300


@pytest.mark.parametrize("make", [binary, text])
def test_a_queue_that_stays_leaves_frames_old_until_the_link_is_opened_anew(make: Make) -> None:
    """Over TCP nothing is lost: what comes steadily and late waits somewhere, however long it has done so."""
    sender, device = opened(make)
    now = steady(sender, device, 50, START)
    now += 60 * PERIOD
    for _ in range(ENDURED // PERIOD - 1):
        now = steady(sender, device, 1, now)
        assert now - device.health.stamp > 500 * MS
    with pytest.raises(DeviceLostError, match=r"0\.6 s late"):
        steady(sender, device, 5, now)
    assert not device.health.connected
    device.close()
    with sender.sending():
        device.open()
    device.read(now := time.monotonic_ns())
    sender.send()
    until(lambda: device.health.stamp > now, lambda: device.read(time.monotonic_ns()))


class Script:
    """A link on which frames come at given times, s, and the clock that goes with it."""

    def __init__(self, arrivals: list[float]) -> None:
        self.arrivals, self.now, self.number = arrivals, 0.0, 0

    def monotonic(self) -> float:
        return self.now

    def read_wait(self, most: float) -> bytes:
        self.now = max(self.now, min(self.arrivals[self.number], self.now + most))
        return self.read()

    def read(self) -> bytes:
        first = self.number
        while self.number < len(self.arrivals) and self.arrivals[self.number] <= self.now:
            self.number += 1
        return b"".join(binary(k) for k in range(first, self.number))

    def close(self) -> None:
        pass


@pytest.mark.parametrize("begins", [-0.05, 0.2, 0.45])
def test_frames_held_up_while_the_rate_is_measured_open_no_link_anew(
    begins: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rate that is a tenth too high would make fresh frames stale within a second, and the suit lost after five."""
    taken = [k / 60 for k in range(12 * 60)]
    over = begins + 0.15  # s: then what was held up comes one by one, as over a slow network
    held = [k for k, at in enumerate(taken) if begins < at < over]
    link = Script([over + 0.0005 * (k - held[0]) if k in held else at for k, at in enumerate(taken)])
    monkeypatch.setattr(driver, "time", link)
    monkeypatch.setattr(driver, "open_transport", lambda *_, **__: link)
    device = suit("tcp://127.0.0.1:1")
    device.open()
    while link.number < len(taken):
        link.now = link.arrivals[link.number]
        device.read(round(link.now * 1e9))
        if link.number > held[-1] + 1:
            assert link.now - device.health.stamp * 1e-9 < device.max_age / 2


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
    assert device.metrics()["gaps"] == 3


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
