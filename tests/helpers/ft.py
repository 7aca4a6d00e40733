"""A force/torque sensor in a cell, with a handle on it that a test pushes, and a twin served in a thread."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.world import Twin
from srl.sim.parts.things.ft_sensor import FtSensorConfig, FtSensorPart, HandleConfig, HandlePart
from srl.sim.world.cell import Cell, CellConfig


def cell(gravity: bool = False, handle: dict[str, Any] | None = None, sensor: dict[str, Any] | None = None) -> Cell:
    """Parts `sensor`, whose mounting face is fixed to the world's origin, and `handle`, mounted on it."""
    parts = {
        "sensor": (FtSensorPart, FtSensorConfig.model_validate({"at": {"position": (0, 0, 0.035)}} | (sensor or {}))),
        "handle": (HandlePart, HandleConfig.model_validate({"at": "sensor/tool"} | (handle or {}))),
    }
    config = CellConfig.model_construct(
        timestep=0.001, gravity=(0.0, 0.0, -9.81 * gravity), floor=False, duration=None, parts=parts
    )
    return Cell(config, seed=3)


def push(world: Cell, *wrench: float) -> None:
    """Pushes the handle; (6,) N, N m, world axes."""
    world.parts["handle"].push(np.array(wrench))  # type: ignore[attr-defined]


def at_sensor(world: Cell, *wrench: float) -> np.ndarray:
    """What the sensor measures of a push at the handle's centre, without gravity."""
    force, torque = np.array(wrench[:3]), np.array(wrench[3:])
    return np.concatenate([force, torque + np.cross([0.0, 0.0, 0.06], force)])


class Server:
    """Steps the world in real time and serves the twin, in a thread; its clock is the driver's, too."""

    def __init__(self, twin: Twin) -> None:
        self.twin, self.world = twin, twin.fake.world
        self.lock = threading.Lock()
        self.stopped = False  # the world and the twin stand still
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._begin = time.monotonic_ns() - self.world.time

    def __enter__(self) -> Server:
        self.twin.open()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.twin.close()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """The world and the twin stand still meanwhile."""
        with self.lock:
            yield

    def _serve(self) -> None:
        while not self._end.is_set():
            with self.lock:
                now = time.monotonic_ns()
                # A machine that was away for long isn't caught up with: the world just goes on later.
                self._begin = max(self._begin, now - self.world.time - 50_000_000)
                self.world.advance(now - self._begin)
                self.twin.service(now)
            time.sleep(0.001)


def bound(driver: Driver) -> Driver:
    """The driver with arrays of its own, full of nan."""
    driver.bind(
        {signal.name: np.full(signal.shape, np.nan) for signal in driver.states},
        {signal.name: np.zeros(signal.shape) for signal in driver.commands},
    )
    return driver


def read(driver: Driver) -> None:
    """One cycle's read, by the clock the server uses."""
    driver.read(time.monotonic_ns())
