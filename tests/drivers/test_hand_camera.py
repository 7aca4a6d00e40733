"""A hand seen by a camera: the messages of the tracker, its twin, and what is no hand."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.wait import until

from srl.drivers.hand_camera import HandCamera, HandCameraConfig
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.models.human_hand import POINTS
from srl.sim.devices.hand_camera.fake import FakeHandCamera, FakeHandCameraOptions
from srl.sim.devices.hand_camera.twin import HandCameraTwin
from srl.sim.devices.shared.sockets import free_port
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import bound


class Watched:
    """The driver on the tracker's twin, in real time."""

    def __init__(self, options: dict[str, Any] | None = None, **changes: Any) -> None:
        config = HandCameraConfig(port=f"udp://127.0.0.1:{free_port()}", start=1.0, **changes)
        world = Cell(CellConfig.model_validate({"parts": {"hand": {"part": "human-hand"}}}), 1)
        self.fake = FakeHandCamera("camera", config, world, FakeHandCameraOptions(**options or {}))
        self.twin = HandCameraTwin(self.fake)
        self.driver = bound(HandCamera("camera", config))
        self.twin.open()
        self._began = time.monotonic_ns()

    def turn(self) -> None:
        now = time.monotonic_ns()
        self.fake.world.advance(now - self._began)
        self.twin.service(now)

    def open(self) -> None:
        link = self.driver.connect()
        self.driver.connect = lambda: link  # type: ignore[method-assign]
        until(lambda: bool(link.read_wait(0.0)), self.turn, pause=0.005)
        until(lambda: self.fake.newest() > 3, self.turn, pause=0.005)
        self.driver.open()

    def cycle(self) -> None:
        self.turn()
        self.driver.read(time.monotonic_ns())

    def close(self) -> None:
        self.driver.close()
        self.twin.close()


@pytest.fixture
def watched() -> Iterator[Watched]:
    made = Watched()
    yield made
    made.close()


def test_the_landmarks_are_the_twins(watched: Watched) -> None:
    watched.open()
    until(lambda: watched.driver.health.frames > 5, watched.cycle)
    seen = watched.driver.state_arrays["landmarks"]
    assert seen.shape == (21, 3)
    assert len(POINTS) == 21
    numbers = range(max(watched.fake.newest() - 3, 0), watched.fake.newest() + 1)
    sent = [watched.fake.landmarks(watched.fake.samples[n], n) for n in numbers]
    assert min(np.abs(each - seen).max() for each in sent) < 1e-5
    assert watched.driver.state_arrays["confidence"][0] == pytest.approx(0.95)
    assert 0.03 < (time.monotonic_ns() - watched.driver.health.stamp) * 1e-9 < 1.0


def test_the_other_hand_and_an_unsure_one_are_none(watched: Watched) -> None:
    watched.open()
    until(lambda: watched.driver.health.frames > 3, watched.cycle)
    watched.twin.right = False
    until(lambda: "right[hand] 0 isn't between" in watched.driver.health.message, watched.cycle)
    frames = watched.driver.health.frames
    until(lambda: watched.driver.health.errors > 5, watched.cycle)
    assert watched.driver.health.frames == frames
    watched.twin.right = True
    until(lambda: watched.driver.health.frames > frames, watched.cycle)


def test_an_unsure_hand_is_none() -> None:
    watched = Watched({"hidden": ((0.0, 1e6),)})
    try:
        watched.open()
        until(lambda: watched.driver.health.errors > 3, watched.cycle)
        assert watched.driver.health.frames == 0
        assert "confidence[hand] 0.1 isn't between 0.6 and 1" in watched.driver.health.message
    finally:
        watched.close()


def test_nobody_before_the_camera_is_said() -> None:
    driver = HandCamera("camera", HandCameraConfig(port=f"udp://127.0.0.1:{free_port()}", start=0.2))
    with pytest.raises(DeviceError, match=r"nothing came within 0\.2 s"):
        driver.open()
