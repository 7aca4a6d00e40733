"""A BNO085 on a part `imu` of the cell: its errors are those of its datasheet."""

from __future__ import annotations

from math import degrees, radians
from typing import Annotated, Final

import numpy as np
from pydantic import AfterValidator, Field

from drivers.bno085 import Bno085, Bno085Config
from drivers.bno085.protocol import WRAP, Record
from drivers.bno085.reading import MG, Reading, expire
from runtime.contracts.driver import DeviceConfig, Sensor
from runtime.contracts.per_element import Finite, PerElement
from runtime.contracts.rotation import euler_angles, exp, from_rpy, matrices, normalised, product
from runtime.contracts.signals import Array
from runtime.contracts.world import FakeConfig, World
from sim.devices.shared.sensor import SampledFake, SensorOptions
from sim.devices.shared.windows import Windows, inside, rising
from sim.parts.things.imu import ImuPart

Tilt = Annotated[tuple[Finite, Finite], PerElement(("x", "y"))]
_HALF: Final = 0.5  # a small rotation is twice the vector part of its quaternion
_LARGEST: Final = 32767  # of an int16


class FakeBno085Config(SensorOptions):
    """Options of the fake."""

    rate: float = Field(default=100.0, gt=5, le=200, description="Hz, frames")
    noise: float = Field(default=0.002, ge=0, description="rad, standard deviation about each axis; ours")
    delay: float = Field(default=0.0083, ge=0, le=0.5, description="s: 6.6 ms in the sensor, 1.7 ms on the wire")
    drift: float = Field(default=radians(0.5) / 60, description="rad/s, of the yaw: 0.5 degrees a minute")
    yaw: float = Field(default=0.0, description="rad, that it reads when it points along x of the world")
    tilt: Tilt = Field(default=(0.0, 0.0), description="rad, constant error about x and y of the world; up to 0.026")
    silent: Annotated[Windows, AfterValidator(rising)] = Field(
        default=(), description="s, [from, to] pairs in world time during which it sends nothing, its cable in place"
    )


class FakeBno085(Sensor, SampledFake):
    """Gives the values that are sent: 0.01 degree and 0.001 g.

    The figures of drift, tilt and delay are of the datasheet's figure 6-12 and section 6.8.
    """

    Options = FakeBno085Config
    real = Bno085

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config, world, options)
        assert isinstance(config, Bno085Config)
        assert isinstance(options, FakeBno085Config)
        self._options, self._order = options, config.order
        self._hold = round(config.hold * 1e9)
        self._reading = Reading(config.order)
        self.imu = self.cell.part(ImuPart, name, options.part)
        self.noise_scale = np.array([_HALF] * 4 + [0.0] * 3)
        self.sampled(7, self._measure)

    def open(self) -> None:
        super().open()
        self._reading = Reading(self._order)

    def read(self, now: int) -> None:
        super().read(now)
        if self.health.stamp < 0 or now - self.health.stamp > self._hold:
            expire(self.state_arrays)

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

    def figures(self) -> dict[str, object]:
        """The rate, and by how much angles and acceleration disagree, degrees."""
        return {"rate_hz": self._options.rate, "disagrees_deg": degrees(self._reading.disagrees)}

    def _is_lost(self, number: int) -> bool:
        return inside(self._options.silent, self.taken_at(number)) or super()._is_lost(number)

    def _measure(self) -> Array:
        """The orientation in the sensor's own reference, whose yaw begins somewhere and drifts."""
        options, values = self._options, self.imu.measured()
        yaw = options.yaw + options.drift * self.imu.seconds
        w, x, y, z = values[:4].tolist()
        tilted = product(exp(*options.tilt, 0.0), (w, x, y, z))
        values[:4] = product(from_rpy(0.0, 0.0, yaw), tilted)
        return values


def record(values: Array, number: int) -> Record:
    """The frame with this number."""
    return Record(number % WRAP, *(int(value) for value in values))
