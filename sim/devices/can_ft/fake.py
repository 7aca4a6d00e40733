"""A Robotous RFT force/torque sensor in the simulated world."""

from __future__ import annotations

from fractions import Fraction
from typing import Literal

import numpy as np
from pydantic import Field

from srl.drivers.can_ft import CanFt
from srl.drivers.can_ft.driver import CanFtConfig
from srl.drivers.can_ft.protocol import DIVISORS
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.force_torque import ForceTorqueFake, ForceTorqueOptions, Range

_REMEMBERED = 0.9  # s of past samples that the filter uses; a sample is kept for 1 s
Model = Literal["RFT40-SA01", "RFT44-SB01", "RFT60-HA01", "RFT64-SB01", "RFT76-HA01", "RFT82-HA02", "RFT80-6A01"]


class FakeCanFtOptions(ForceTorqueOptions):
    """Options of the fake; the device's own `rate` sets the sample rate."""

    rate: float = Field(default=200.0, gt=0, le=1000, description="not used: the device's own 'rate' decides")
    delay: float = Field(default=0.001, ge=0, le=0.5, description="s, from sampling to arrival")
    range: Range = Field(default=(200.0, 200.0, 200.0, 4.0, 4.0, 4.0), description="N, N m: overload beyond it")
    model: Model = "RFT64-SB01"
    serial: str = Field(default="SIM0001", max_length=15)
    bus: str | None = Field(
        default=None, description="can://INTERFACE/CHANNEL the twin joins; None: multicast that stays on this host"
    )


class FakeCanFt(ForceTorqueFake):
    """See `ForceTorqueFake`; samples at the device's `rate`, and filters and quantises as the sensor does."""

    Options = FakeCanFtOptions
    real = CanFt
    config: CanFtConfig

    def __init__(self, name: str, config: CanFtConfig, world: World, options: FakeCanFtOptions) -> None:
        super().__init__(name, config, world, options.model_copy(update={"rate": float(config.rate)}))
        self.model, self.serial = options.model, options.serial
        per_force, per_torque = DIVISORS[options.model]
        if config.counts is not None:
            self.counts = np.array([config.counts.force] * 3 + [config.counts.torque] * 3)
        else:
            self.counts = np.array([float(per_force)] * 3 + [float(per_torque)] * 3)
        self.rate: int = config.rate
        self.cutoff = config.filter
        self._biases = config.bias

    def open(self) -> None:
        first = not self.health.was_open
        super().open()
        if self._biases and first:
            self.bias()

    def quantise(self, values: Array) -> Array:
        return self.raw(values) / self.counts

    # -- the sensor itself, used by the fake and the twin

    def raw(self, values: Array) -> Array:
        """(6,) counts: whole numbers that fit into 16 bits."""
        return np.clip(np.rint(values * self.counts), -32768, 32767)

    def set_rate(self, rate: int) -> None:
        """Changes the sample rate (Hz) from now on."""
        if rate != self.rate:
            self.rate = rate
            self._sensor_options = self._sensor_options.model_copy(update={"rate": float(Fraction(rate))})
            self.sampled(6, lambda: self.part.wrench)
            self._last = self.newest()

    def arriving(self, number: int) -> Array:
        """Filtered with a first-order low-pass."""
        if self.cutoff == 0:
            return super().arriving(number)
        # Computed again from the stored samples, so that the filter has no state to save.
        keep = np.exp(-2 * np.pi * self.cutoff / self.rate)
        length = min(number + 1, int(_REMEMBERED * self.rate), int(7 / -np.log(keep)) + 1)
        weights = keep ** np.arange(length)
        rows = np.array([self._before_filter(number - i) for i in range(length)])
        return self.quantise(weights @ rows / weights.sum())

    def _before_filter(self, number: int) -> Array:
        values = self.samples[number] + self._offset
        if self._sensor_options.noise:
            values = values + self._noise.noise(number)
        return np.clip(values, -self.range, self.range) - self._bias
