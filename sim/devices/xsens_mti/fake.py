"""An MTi on a part `imu` of the cell."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from srl.drivers.xsens_mti import XsensMti, XsensMtiConfig
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.rotation import normalised
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.inertial import HALF, InertialFake, InertialOptions

_FORCE, _TURN = 5.0, 1.0  # m/s^2 and rad/s of noise a rad: a still sensor flickers by some mm/s^2 and mrad/s; ours


class FakeXsensMtiConfig(InertialOptions):
    """Options of the fake."""

    rate: float = Field(default=100.0, gt=5, le=400, description="Hz, messages; the profile's `rate` is what is asked")
    noise: float = Field(default=0.001, ge=0, description="rad, standard deviation about each axis; ours")
    delay: float = Field(
        default=0.008, ge=0, le=0.5, description="s: 2 ms in the sensor, 6 ms on a line of 115200; ours"
    )


class FakeXsensMti(Sensor, InertialFake):
    """Gives what is sent, in numbers of 32 bits."""

    Options = FakeXsensMtiConfig
    real = XsensMti

    def __init__(self, name: str, config: XsensMtiConfig, world: World, options: FakeXsensMtiConfig) -> None:
        super().__init__(name, config, world, options)
        self.noise_scale = np.array([HALF] * 4 + [_FORCE] * 3 + [_TURN] * 3)
        self.sampled(10, lambda: np.concatenate([self.measure(), self.imu.turning()]))

    def quantise(self, values: Array) -> Array:
        """(10,): w x y z, m/s^2, rad/s as they leave: a unit quaternion, float32."""
        w, x, y, z = values[:4].tolist()
        values[:4] = normalised((w, x, y, z))
        return values.astype(np.float32).astype(float)

    def fill(self, values: Array, number: int) -> None:
        w, x, y, z = values[:4].tolist()
        states = self.state_arrays
        states["orientation"][:], states["acceleration"][:] = normalised((w, x, y, z)), values[4:7]
        states["turn"][:] = values[7:]
