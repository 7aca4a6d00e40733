"""Simulated MIT-mode actuators: a chain, the fake on it, and figures of what its wearer would feel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from helpers.sim import bind
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.contracts.signals import Array, Stop
from srl.sim.devices.mit_can.drives import Drives
from srl.sim.devices.mit_can.fake import FakeMitCan
from srl.sim.devices.mit_can.twin import MitCanTwin
from srl.sim.world.cell import Cell, CellConfig

PERIOD = 2_000_000  # ns: 500 cycles a second
ONE: dict[str, dict[str, Any]] = {"elbow": {"model": "DM4340", "kp": 40, "kd": 2}}
TWO: dict[str, dict[str, Any]] = {
    "shoulder": {"model": "DM8009", "kp": 80, "kd": 2.5},
    "elbow": {"model": "DM4340", "kp": 40, "kd": 2},
}
SEVEN: dict[str, dict[str, Any]] = {
    f"j{k}": {"model": "DM8009", "kp": 80, "kd": 2.5} if k < 4 else {"model": "DM4340", "kp": 40, "kd": 2}
    for k in range(1, 8)
}
AK: dict[str, dict[str, Any]] = {
    "shoulder": {"model": "AK10-9", "kp": 80, "kd": 2.5, "park": 0.0},
    "elbow": {"model": "AK80-9", "kp": 40, "kd": 2, "park": 0.0},
}
MAKERS: dict[str, dict[str, Any]] = {
    "damiao": {"maker": "damiao"},
    "v2": {"maker": "cubemars", "firmware": "v2", "enable_at_open": True},
    "v3": {"maker": "cubemars", "firmware": "v3", "enable_at_open": True},
}
_BUILT = ("model", "m_per_rad", "reversed", "zero")


def cell(
    motors: dict[str, dict[str, Any]] = TWO, *, hanging: bool = True, start: float = 0.0, length: float = 0.25,
    mass: float = 0.4, **options: Any,
) -> Cell:  # fmt: skip
    """A chain `arm` whose links (m, kg) lie level and turn downwards, if `hanging`; else without gravity."""
    axes = {
        name: {"axis": [0, 1, 0], "link": [length, 0, 0], "mass": mass, "lower": -20.0, "upper": 20.0, "start": start}
        | {key: value for key, value in motor.items() if key in _BUILT}
        for name, motor in motors.items()
    }
    part = {"part": "actuator-chain", "axes": axes} | options
    gravity = [0, 0, -9.81] if hanging else [0, 0, 0]
    return Cell(CellConfig.model_validate({"parts": {"arm": part}, "gravity": gravity}), 1)


def config(motors: dict[str, dict[str, Any]] = TWO, maker: str = "damiao", **options: Any) -> MitCanConfig:
    """Ids from 1 on in the motors' order, unless given; a travel of ±2."""
    numbered = {
        name: {"id": k, "lower": -2.0, "upper": 2.0} | motor for k, (name, motor) in enumerate(motors.items(), 1)
    }
    base = {"port": "can://virtual/none", "motors": numbered} | MAKERS[maker]
    return MitCanConfig.model_validate(base | options)


class Limb:
    """The fake with its world, cycle by cycle."""

    def __init__(
        self, motors: dict[str, dict[str, Any]] = TWO, maker: str = "damiao", world: Cell | None = None,
        fake: dict[str, Any] | None = None, **options: Any,
    ) -> None:  # fmt: skip
        self.world = world or cell(motors)
        self.fake = FakeMitCan("bus", config(motors, maker, **options), self.world, FakeMitCan.Options(**(fake or {})))
        bind(self.fake)
        self.name = self.fake.commands[0].name

    def open(self) -> Limb:
        self.fake.open()
        self.fake.read(self.world.time)
        return self

    @property
    def drives(self) -> Drives:
        return self.fake.drives

    @property
    def fault(self) -> str:
        return self.fake.health.fault

    def state(self, name: str) -> Array:
        return self.fake.state_arrays[name].copy()

    def truth(self, name: str = "position") -> Array:
        return self.world.truth_arrays[f"arm_{name}"].copy()

    @property
    def on(self) -> list[bool]:
        motors = self.drives.motors
        return [bool(motors.torque[i]) for i in self.drives.numbers]

    def run(
        self, seconds: float, command: Any = None, stop: Stop | None = None,
        until: Callable[[], bool] | None = None, look: Callable[[], Any] | None = None,
    ) -> float:  # fmt: skip
        """Runs cycles: commanded, stopping, or idle. Returns the seconds until `until` held, or all."""
        cycles = round(seconds * 1e9 / PERIOD)
        for k in range(cycles):
            now = self.world.time
            self.fake.read(now)
            if command is not None:
                wanted = command(k * PERIOD * 1e-9) if callable(command) else command
                self.fake.command_arrays[self.name][:] = wanted
                self.fake.write(now)
            elif stop is not None:
                self.fake.stop(stop)
            self.world.advance(now + PERIOD)
            if look is not None:
                look()
            if until is not None and until():
                return (k + 1) * PERIOD * 1e-9
        return seconds

    def hold(self, seconds: float = 0.7) -> Array:
        """Takes the limb up where it stands; returns that command."""
        where = self.state("position")
        self.run(seconds, where)
        assert not self.fault, self.fault
        assert all(self.on)
        return where


def peak(values: list[Array]) -> float:
    """The largest magnitude."""
    return float(np.max(np.abs(values)))


def twin(
    motors: dict[str, dict[str, Any]] = TWO,
    maker: str = "damiao",
    world: Cell | None = None,
    bus: str | None = None,
    **options: Any,
) -> MitCanTwin:
    """The twin of such a bus; None: a multicast bus that stays on this host."""
    fake = FakeMitCan("bus", config(motors, maker, **options), world or cell(motors), FakeMitCan.Options(bus=bus))
    return MitCanTwin(fake)
