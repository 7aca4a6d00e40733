"""A chain of simulated STS servos, its twin, and the driver on it, in lockstep."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.dynamixel import Rig
from helpers.twin import Bench, bound
from srl.drivers.feetech import Feetech
from srl.drivers.feetech.config import FeetechConfig
from srl.runtime.contracts.signals import Array
from srl.sim.devices.feetech.fake import FakeFeetech, FakeFeetechConfig
from srl.sim.devices.feetech.twin import FeetechTwin
from srl.sim.world.cell import Cell, CellConfig

TWO: dict[str, dict[str, Any]] = {"shoulder": {"model": "STS3250"}, "elbow": {"model": "STS3215"}}
_BUILT = ("model", "m_per_rad", "reversed", "zero")


def cell(motors: dict[str, dict[str, Any]] = TWO, seed: int = 1, **options: Any) -> Cell:
    """A chain `arm` with these motors, without gravity unless it is given."""
    gravity = options.pop("gravity", [0, 0, 0])
    axes = {
        name: {"axis": [0, 1, 0] if k else [0, 0, 1], "lower": -20.0, "upper": 20.0}
        | {key: value for key, value in motor.items() if key in _BUILT}
        for k, (name, motor) in enumerate(motors.items())
    }
    part = {"part": "feetech-chain", "axes": axes} | options
    return Cell(CellConfig.model_validate({"parts": {"arm": part}, "gravity": gravity}), seed)


def config(motors: dict[str, dict[str, Any]] = TWO, port: str = "/dev/null", **options: Any) -> FeetechConfig:
    """Ids from 1 on in the motors' order, unless given."""
    numbered = {name: {"id": k} | motor for k, (name, motor) in enumerate(motors.items(), 1)}
    return FeetechConfig.model_validate({"port": port, "motors": numbered} | options)


def make_twin(motors: dict[str, dict[str, Any]] = TWO, world: Cell | None = None, **options: Any) -> FeetechTwin:
    """The twin of such a bus."""
    fake = FakeFeetech("bus", config(motors, **options), world or cell(motors), FakeFeetechConfig())
    return FeetechTwin(fake)


class FeetechRig(Rig):
    """As `Rig`, with this driver."""

    def __init__(self, twin: FeetechTwin, **options: Any) -> None:
        self.twin: Any = twin
        self.bench = Bench(twin)
        base = twin.bus.config.model_dump() | {"port": twin.address} | options
        self.driver: Any = bound(Feetech("bus", FeetechConfig.model_validate(base)))
        self.log: list[tuple[int, Array]] = []
        self.open()

    def hold(self, cycles: int = 5) -> Array:
        """Takes up command where the axes are; gives that command."""
        self.start()
        where = self.state["position"].copy()
        self.run(cycles, where)
        return where

    @property
    def fault(self) -> str:
        """What the driver tells."""
        return str(self.driver.health.fault)

    @property
    def torque(self) -> list[bool]:
        """Of the servos."""
        return [bool(on) for on in self.twin.metrics()["torque"]]

    @property
    def goals(self) -> list[int]:
        """What the servos have stored."""
        return [servo.get("goal_position") for servo in self.twin.servos]

    def truth(self) -> Array:
        """rad, of the axes."""
        return np.array(self.twin.bus.world.truth_arrays["arm_position"])
