"""A twin with its world, stepped by a simulated clock in the test's own thread, and a bare client."""

from __future__ import annotations

import os
import select
import tty
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Self

import numpy as np
from numpy.typing import NDArray

from helpers.background import repeating
from helpers.wait import until
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Twin
from srl.sim.parts.hand.human_hand import HumanHandConfig, HumanHandPart
from srl.sim.world.cell import Cell, CellConfig

STEP = 1_000_000  # ns
TIMEOUT = 10.0  # s of real time, for a pty to deliver


class StillHand(HumanHandPart):
    """A hand that doesn't move."""

    def position(self, at: int | None = None) -> Array:
        return np.zeros(20)


class StillWorld(Cell):
    """A hand that doesn't move, for wires alone: there is no physics."""

    def __init__(self) -> None:
        super().__init__(CellConfig.model_validate({"parts": {"hand": {"part": "human-hand"}}}), seed=1)
        self.parts["hand"] = StillHand("hand", HumanHandConfig(), 1)

    def advance(self, until: int) -> None:
        self.time = until

    def save(self) -> NDArray[np.float64]:
        return np.array([float(self.time)])

    def restore(self, state: NDArray[np.float64]) -> None:
        self.time = int(state[0])


class Bench:
    """Steps a world and services its twin; both clocks start at 0 and stay the same."""

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.world = twin.fake.world
        self.now = self.world.time
        twin.open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.twin.close()

    def run(self, seconds: float) -> None:
        """Lets simulated time pass."""
        for _ in range(round(seconds * 1e9) // STEP):
            self.now += STEP
            self.world.advance(self.now)
            self.twin.service(self.now)

    def take(self, count: int) -> None:
        """Services, at the same instant, until `count` more bytes than ever before have come in."""
        goal = self._taken() + count
        until(
            lambda: self._taken() >= goal,
            lambda: self.twin.service(self.now),
            what=lambda: f"{goal - self._taken()} more bytes",
            pause=0.0,
        )

    def _taken(self) -> int:
        count = self.twin.metrics()["bytes_in"]
        assert isinstance(count, int)
        return count

    def running(self, frozen: bool = False) -> AbstractContextManager[None]:
        """Runs in a thread meanwhile, for what blocks: a driver's `open`. `frozen`: the world waits."""

        def turn() -> None:
            self.now += STEP
            if not frozen:
                self.world.advance(self.now)
            self.twin.service(self.now)

        return repeating(turn, 0.0005)


class Client:
    """The other end of a twin's port, without any protocol."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.fd = os.open(bench.twin.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.fd)
        bench.twin.service(bench.now)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leaves the port."""
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1

    def send(self, data: bytes) -> None:
        """Sends, and waits until the twin has taken all of it."""
        os.write(self.fd, data)
        self.bench.take(len(data))

    def read(self, size: int) -> bytes:
        """Exactly `size` bytes, which must be on their way."""
        poll = select.poll()
        poll.register(self.fd, select.POLLIN)
        found = b""
        while len(found) < size:
            assert poll.poll(TIMEOUT * 1000), f"only {found.hex(' ')} of {size} bytes"
            found += os.read(self.fd, size - len(found))
        return found

    def rest(self) -> bytes:
        """What else has come; b"" only after a while without a byte."""
        found = b""
        poll = select.poll()
        poll.register(self.fd, select.POLLIN)
        while poll.poll(50):
            found += os.read(self.fd, 4096)
        return found

    def ask(self, data: bytes, size: int) -> bytes:
        """Sends and reads the answer of a known size, behind which nothing else may come."""
        self.send(data)
        return self.read(size)


def bound(driver: Driver, commands: Mapping[str, Array] | None = None) -> Driver:
    """The driver with arrays of its own."""
    driver.bind(
        {signal.name: np.full(signal.shape, np.nan) for signal in driver.states},
        {signal.name: (commands or {}).get(signal.name, np.zeros(signal.shape)).copy() for signal in driver.commands},
    )
    return driver
