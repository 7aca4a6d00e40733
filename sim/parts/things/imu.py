"""The cell's part `imu`: a small case with an inertial sensor in it, on any body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import QUATERNION
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_LAG: Final = 0.008  # s, of the accelerometer's low-pass, 20 Hz; ours


class ImuConfig(PartConfig):
    """Options of the part."""

    mass: float = Field(0.005, gt=0, description="kg, of the breakout board in its case; ours")


class ImuPart(Part):
    """Body `NAME/case`, whose axes are the sensor's. It stands at the frame that its device names.

    Truth: `NAME_orientation` (4,), w x y z, of the sensor in the world.
    """

    Config = ImuConfig
    summary = "an inertial sensor, on any body"

    def __init__(self, name: str, config: ImuConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._mass = config.mass
        self.every = 1
        self.truth = (Signal(name=f"{name}_orientation", shape=(4,), unit="1", labels=QUATERNION),)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        case = mjcf.body(parent, f"{self.name}/case", **self.at())
        size = {"type": "box", "size": (0.013, 0.011, 0.004), "rgba": "0.1 0.25 0.5 1"}
        add(case, "geom", name=f"{self.name}/case", mass=self._mass, **size, **CONTACT["none"])
        add(case, "site", name=f"{self.name}/chip")
        for kind, what in (("accelerometer", "acceleration"), ("gyro", "turn")):
            add(mjcf.sensor, kind, name=f"{self.name}/{what}", site=f"{self.name}/chip")

    def bind(self, model: Any, data: Any) -> None:
        self._data = data
        at = int(model.sensor(f"{self.name}/acceleration").adr[0])
        self._now = data.sensordata[at : at + 3]
        turn = int(model.sensor(f"{self.name}/turn").adr[0])
        self._turn = data.sensordata[turn : turn + 3]
        self._force = np.zeros(3)
        self._share = float(model.opt.timestep / (model.opt.timestep + _LAG))
        self._body = int(model.body(f"{self.name}/case").id)

    def drive(self, step: int) -> None:
        # Unfiltered, samples at the instants at which a motion's target changes would have a mean of their own.
        self._force += self._share * (self._now - self._force)

    @property
    def seconds(self) -> float:
        """s of the physics."""
        return float(self._data.time)

    def measured(self) -> Array:
        """(7,): w x y z in the world, and the specific force in the sensor's axes, m/s^2."""
        return np.concatenate([self._data.xquat[self._body], self._force])

    def turning(self) -> Array:
        """(3,): rate of turn in the sensor's axes, rad/s."""
        found: Array = self._turn.copy()
        return found

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[self.truth[0].name][:] = self._data.xquat[self._body]

    def save(self) -> Array:
        return self._force.copy()

    def restore(self, state: Array) -> None:
        self._force[:] = state
