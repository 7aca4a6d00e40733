"""A SoftHand in the simulated world: its electronics, between the command and the cell's hand."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.softhand import SoftHand
from srl.drivers.softhand.config import USUAL, SoftHandConfig
from srl.drivers.softhand.driver import COMMAND
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.parts.robots.softhand import CLOSED, SoftHandPart

CURRENT_NOISE: Final = 0.005  # A per encoder tick of noise


class FakeSoftHandOptions(SensorOptions):
    """Options of the fake; `noise` is in encoder ticks, the current has 5 mA of noise for each."""

    rate: float = Field(default=400.0, gt=0, le=1000, description="Hz of measurements")
    noise: float = Field(default=3.0, ge=0, description="ticks, standard deviation of the position")
    delay: float = Field(default=0.002, ge=0, le=0.5, description="s, from a measurement to its arrival")


class FakeSoftHand(SampledFake):
    """Gives the driver's states and takes its command; the motor is off until the first command.

    `read`, `write` and `stop` are the driver's interface. `activate`, `refer` and `newest_measurement` are the
    electronics; the twin uses them, too. The cell's part stores the motor's state, so a restored world restores it.
    """

    Options = FakeSoftHandOptions
    real = SoftHand
    config: SoftHandConfig

    def __init__(self, name: str, config: SoftHandConfig, world: World, options: FakeSoftHandOptions) -> None:
        super().__init__(name, config, world, options)
        low, high = config.limits or USUAL
        self.open_ticks, self.closed_ticks = low, high
        self._span = float(high - low)
        self.noise_scale = np.array([1.0 / self._span, CURRENT_NOISE])
        self.part = self.cell.part(SoftHandPart, name, getattr(options, "part", None))
        self.sampled(2, lambda: np.array([self.part.position / CLOSED, self.part.current]))

    def write(self, now: int) -> None:
        self.check_there()
        if not self.active:
            self.activate(True)
        closure = float(self.command_arrays[COMMAND][0])
        if isfinite(closure):
            self.sent_arrays[COMMAND][0] = min(max(closure, 0.0), 1.0)
            self.refer(round(self.open_ticks + min(max(closure, 0.0), 1.0) * self._span))

    def stop(self, category: Stop) -> None:
        if category is Stop.LIMP and self.health.connected:
            self.activate(False)

    def close(self) -> None:
        """Switches the motor off, as the driver does; if the hand is lost, its watchdog switches it off."""
        if self.health.connected or (self.health.was_open and self._config_watchdog):
            self.activate(False)
        super().close()

    def fill(self, values: Array, number: int) -> None:
        self.state_arrays["position"][0] = values[0]
        self.state_arrays["current"][0] = values[1]

    def quantise(self, values: Array) -> Array:
        values[0] = np.rint(values[0] * self._span) / self._span
        values[1] = np.rint(values[1] * 1e3) * 1e-3
        return values

    # -- the electronics, used by the fake and the twin

    @property
    def active(self) -> bool:
        """Whether the motor has power."""
        return self.part.commanded is not None

    def activate(self, on: bool) -> None:
        """Switches the motor on or off; when switched on, its reference is its present position."""
        if on and not self.active:
            self.part.command_position(self.part.position)
        elif not on:
            self.part.command_position(None)

    def refer(self, ticks: int) -> None:
        """Sets the motor's reference, within its range; ignored while the motor is off."""
        if self.active:
            inside_range = min(max(ticks, self.open_ticks), self.closed_ticks)
            self.part.command_position((inside_range - self.open_ticks) / self._span * CLOSED)

    def newest_measurement(self) -> tuple[int, int]:
        """The position (ticks) and the current (mA) measured last."""
        values = self.sample(max(self.samples.newest(), 0))
        if values is None:
            values = self.samples[max(self.samples.newest(), 0)]
        return round(self.open_ticks + float(values[0]) * self._span), round(float(values[1]) * 1000)

    @property
    def _config_watchdog(self) -> bool:
        return self.config.watchdog > 0
