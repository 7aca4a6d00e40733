"""A BNO085 on a part `imu` of the cell: its errors are those of its datasheet."""

from __future__ import annotations

from math import degrees
from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.bno085 import Bno085, Bno085Config
from srl.drivers.bno085.protocol import WRAP, Record
from srl.drivers.bno085.reading import MG, Reading
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.rotation import euler_angles, matrices, normalised
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.inertial import HALF, InertialFake, InertialOptions

_LARGEST: Final = 32767  # of an int16


class FakeBno085Config(InertialOptions):
    """Options of the fake."""

    rate: float = Field(default=100.0, gt=5, le=200, description="Hz, frames")
    noise: float = Field(default=0.002, ge=0, description="rad, standard deviation about each axis; ours")
    delay: float = Field(default=0.0083, ge=0, le=0.5, description="s: 6.6 ms in the sensor, 1.7 ms on the wire")


class FakeBno085(Sensor, InertialFake):
    """Gives the values that are sent: 0.01 degree and 0.001 g.

    The figures of drift, tilt and delay are of the datasheet's figure 6-12 and section 6.8.
    """

    Options = FakeBno085Config
    real = Bno085

    def __init__(self, name: str, config: Bno085Config, world: World, options: FakeBno085Config) -> None:
        super().__init__(name, config, world, options)
        self._options, self._order = options, config.order
        self._reading = Reading(config.order)
        self.noise_scale = np.array([HALF] * 4 + [0.0] * 3)
        self.sampled(7, self.measure)

    def open(self) -> None:
        super().open()
        self._reading = Reading(self._order)

    def quantise(self, values: Array) -> Array:
        """(6,): yaw, pitch, roll, 0.01 degree; x, y, z, 0.001 g."""
        w, x, y, z = values[:4].tolist()
        angles = euler_angles(matrices(np.array([normalised((w, x, y, z))])), self._order)[0]
        wire = np.concatenate([np.degrees(angles) * 100.0, values[4:] / MG])
        rounded: Array = np.clip(np.rint(wire), -_LARGEST, _LARGEST)
        return rounded

    def fill(self, values: Array, number: int) -> None:
        health = self.health
        used = self._reading.fill(record(values, number), self.state_arrays)
        health.message = "" if used else self._reading.trouble()

    def metrics(self) -> dict[str, object]:
        """The rate, and by how much angles and acceleration disagree, degrees."""
        return {"rate_hz": self._options.rate, "disagrees_deg": degrees(self._reading.disagrees)}


def record(values: Array, number: int) -> Record:
    """The frame with this number."""
    return Record(number % WRAP, *(int(value) for value in values))
