"""A UR arm: cell, fake, twin behind free ports, and drivers on either side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from helpers.twin import Bench, bound
from helpers.wait import until
from srl.drivers.ur import Ur, UrConfig
from srl.runtime.contracts.driver import Driver
from srl.sim.devices.ur.fake import FakeUr, FakeUrConfig
from srl.sim.devices.ur.twin import UrTwin
from srl.sim.world.cell import Cell, CellConfig


def make_fake(config: dict[str, Any] | None = None, parts: dict[str, Any] | None = None, **options: Any) -> FakeUr:
    """A UR16e in a cell of its own, without noise and delay unless asked for, and with arrays."""
    cell = Cell(CellConfig(parts={"arm": {"part": "ur16e"}, **(parts or {})}), seed=1)
    given = UrConfig(**{"port": "tcp://127.0.0.1", **(config or {})})
    fake = FakeUr("arm", given, cell, FakeUrConfig(**{"noise": 0.0, "delay": 0.0, **options}))
    bound(fake)
    return fake


def advance(fake: Driver, cycles: int, each: Callable[[], None] = lambda: None) -> None:
    """Lets the fake's world run by control cycles: advance, read, `each`."""
    world = fake.world  # type: ignore[attr-defined]
    for _ in range(cycles):
        world.advance(world.time + 2_000_000)
        fake.read(world.time)
        each()


class Rig:
    """A twin with its world, in the test's own thread, and the driver that talks to it in lockstep.

    Attributes:
        fake, twin, bench, driver: what they say.
        now: ns, of the world and of the driver.
    """

    def __init__(self, config: dict[str, Any] | None = None, **options: Any) -> None:
        self.fake = make_fake(config, **options)
        self.twin = UrTwin(self.fake)
        self.bench = Bench(self.twin)
        self.driver = self.another(config)

    def another(self, config: dict[str, Any] | None = None) -> Ur:
        """One more driver of the same arm."""
        driver = Ur("arm", UrConfig(**{**(config or {}), "port": self.twin.address}))
        bound(driver)
        return driver

    @property
    def now(self) -> int:
        return self.bench.now

    def open(self) -> Ur:
        """Opens the driver while the twin runs."""
        with self.bench.running():
            self.driver.open()
        return self.driver

    def cycle(self, write: bool = False) -> None:
        """One control cycle of 2 ms: the world steps, the driver reads its sample and, if asked, writes."""
        frames = self.driver.health.frames
        self.bench.run(0.002)

        def sampled() -> bool:
            self.driver.read(self.now)
            return self.driver.health.frames > frames

        until(sampled, lambda: self.twin.service(self.now), what="a sample", pause=0.0)
        if write:
            sequence = self.driver._numbers.sequence
            self.driver.write(self.now)
            self.settle(self.driver._numbers.sequence != sequence)

    def settle(self, commands: int = 1) -> None:
        """Waits until the twin has taken so many more commands of the driver's."""
        goal = self.taken() + commands
        until(lambda: self.taken() >= goal, lambda: self.twin.service(self.now), what="the command", pause=0.0)

    def taken(self) -> int:
        """Commands that the twin has taken so far."""
        return self.twin.rtde.seen.get("U", 0)

    def follow(self, values: Any, cycles: int) -> None:
        """Commands the same values in each of so many cycles."""
        self.driver.command_arrays[self.driver.commands[0].name][:] = values
        for _ in range(cycles):
            self.cycle(write=True)

    def until(self, condition: Callable[[], Any], write: bool = False, cycles: int = 20_000) -> None:
        """Cycles until it holds."""
        for _ in range(cycles):
            if condition():
                return
            self.cycle(write)
        raise AssertionError(f"it never came: fault '{self.driver.health.fault}', {self.driver.health.message}")

    def close(self) -> None:
        self.driver.close()
        self.twin.close()

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def speed(fake: FakeUr) -> float:
    """rad/s of the fastest joint, as it really is."""
    return float(np.abs(fake.controller.arm.velocity).max())
