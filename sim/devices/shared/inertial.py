"""What the fakes of inertial sensors share: a part `imu` of the cell, yaw that drifts, tilt that is off, silence."""

from __future__ import annotations

from math import radians
from typing import Annotated

from pydantic import Field

from srl.drivers.serial_imu import SerialImuConfig, expire
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.rotation import exp, from_rpy, product
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.parts.things.imu import ImuPart

Tilt = Annotated[tuple[Finite, Finite], PerElement(("x", "y"))]
HALF = 0.5  # a small rotation is twice the vector part of its quaternion


class InertialOptions(SensorOptions):
    """Options of the fakes; a subclass sets the defaults of its sensor."""

    drift: float = Field(default=radians(0.5) / 60, description="rad/s, of the yaw: 0.5 degrees a minute")
    yaw: float = Field(default=0.0, description="rad, that it reads when it points along x of the world")
    tilt: Tilt = Field(default=(0.0, 0.0), description="rad, constant error about x and y of the world; up to 0.026")
    silent: Windows = Field(
        default=(), description="s, [from, to] pairs in world time during which it sends nothing, its cable in place"
    )


class InertialFake(SampledFake):
    """Measures a part `imu`; a subclass calls `sampled` with what it takes of it.

    Attributes:
        imu: the part.
    """

    Options = InertialOptions

    def __init__(self, name: str, config: SerialImuConfig, world: World, options: InertialOptions) -> None:
        super().__init__(name, config, world, options)
        self._inertial, self._hold = options, round(config.hold * 1e9)
        self.imu = self.cell.part(ImuPart, name, options.part)

    def read(self, now: int) -> None:
        super().read(now)
        if self.health.stamp < 0 or now - self.health.stamp > self._hold:
            expire(self.state_arrays)

    def measure(self) -> Array:
        """(7,): the orientation in the sensor's own reference, whose yaw begins somewhere and drifts, and the force."""
        options, values = self._inertial, self.imu.measured()
        yaw = options.yaw + options.drift * self.imu.seconds
        w, x, y, z = values[:4].tolist()
        tilted = product(exp(*options.tilt, 0.0), (w, x, y, z))
        values[:4] = product(from_rpy(0.0, 0.0, yaw), tilted)
        return values

    def _is_lost(self, number: int) -> bool:
        return inside(self._inertial.silent, self.taken_at(number)) or super()._is_lost(number)
