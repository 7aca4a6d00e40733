"""What the fakes of force/torque sensors share: offset, range, saturation, bias."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.per_element import PerElement, Positive
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import WRENCH
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.parts.things.ft_sensor import FtSensorPart, Vector6

Range = Annotated[tuple[Positive, Positive, Positive, Positive, Positive, Positive], PerElement(WRENCH)]


class ForceTorqueOptions(SensorOptions):
    """Options of the fake; `noise` is in N, the noise of torques is `noise` times TORQUE_NOISE, in N m."""

    noise: float = Field(default=0.02, ge=0, description="N, standard deviation of each force")
    offset: Vector6 = Field(default=(0.0,) * 6, description="N, N m, what it reads without any load")
    range: Range = Field(
        default=(400.0, 400.0, 400.0, 20.0, 20.0, 20.0), description="N, N m: beyond it the sensor saturates"
    )


TORQUE_NOISE = 0.02  # m


class ForceTorqueFake(Sensor, SampledFake):
    """The common base of force/torque fakes.

    Its state is `wrench` (6,) in the sensor's frame. A saturated sample doesn't arrive, as with the real drivers.
    """

    Options = ForceTorqueOptions
    noise_scale = np.array([1.0] * 3 + [TORQUE_NOISE] * 3)

    def __init__(self, name: str, config: DeviceConfig, world: World, options: ForceTorqueOptions) -> None:
        super().__init__(name, config, world, options)
        self._offset = np.array(options.offset)
        self.range: Array = np.array(options.range)
        self._least = -self.range
        self.ranges["wrench"] = -2 * self.range, 2 * self.range
        self._bounds = self._offset.tolist(), self.range.tolist()
        self._bias: Array = np.zeros(6)
        self.part = self.cell.part(FtSensorPart, name, options.part)
        frame = self.states[0].frame
        at = self.part.config.at or self.part.name
        if frame in world.frames.entries and at != frame:
            problem = f"the device says that it measures in '{frame}', and the part stands at {at!r}"
            remedy = f"Write `at: {frame}`; `off_by:` makes the world differ from what the profile says"
            raise WiringError(f"sim.parts.{self.part.name}.at", problem, remedy)
        self.sampled(6, lambda: self.part.wrench)

    def fill(self, values: Array, number: int) -> None:
        self.state_arrays["wrench"][:] = values

    # -- the sensor itself, used by the fake and the twin

    def overload(self, number: int) -> tuple[bool, ...]:
        """For each of the six axes, whether a sample exceeds the range."""
        return tuple((np.abs(self.samples[number] + self._offset) > self.range).tolist())

    def measured(self, number: int) -> Array | None:
        """The measured wrench (6,), N and N m, clipped to the range if saturated; None if the sample is lost."""
        return None if super()._is_lost(number) else self.arriving(number)

    def arriving(self, number: int) -> Array:
        values = self.samples[number].copy()
        if self._sensor_options.noise:
            values += self._noise.noise(number)
        values += self._offset
        np.minimum(np.maximum(values, self._least, out=values), self.range, out=values)
        values -= self._bias
        return self.quantise(values)

    def bias(self) -> None:
        """Takes the present reading as zero."""
        newest = self.samples.newest()
        if newest >= 0:
            self._bias = np.clip(self.samples[newest] + self._offset, -self.range, self.range)

    def unbias(self) -> None:
        """Clears the bias, as a loss of power does."""
        self._bias = np.zeros(6)

    def _is_lost(self, number: int) -> bool:
        return super()._is_lost(number) or (self.samples.keeps(number) and self._saturated(number))

    def _saturated(self, number: int) -> bool:
        # As any of `overload`, in plain numbers: this is asked of each sample.
        for value, offset, most in zip(self.samples[number].tolist(), *self._bounds, strict=True):
            if abs(value + offset) > most:
                return True
        return False
