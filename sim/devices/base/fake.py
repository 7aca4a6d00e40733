"""A mobile base in the cell; it drives on the floor, and its wheel odometry differs from the true pose."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.base import BaseConfig, MobileBase, protocol
from srl.drivers.base.config import TOP_SPEED, TOP_TURN
from srl.drivers.base.driver import COMMAND, FARTHEST, PRESSED
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.parts.robots.summit_xl import SummitXlPart

WATCHDOG: Final = 500_000_000  # ns without a command after which the robot stops (protocol sheet, section 1)
WATCH: Final = 50_000_000  # ns of world time between two checks of the watchdog


class FakeBaseOptions(SensorOptions):
    """Options of the fake."""

    rate: float = Field(default=50.0, gt=0, le=1000, description="Hz, odometry messages")
    noise: float = Field(default=0.002, ge=0, description="m/s, standard deviation of the twist's vx and vy")
    delay: float = Field(default=0.01, ge=0, le=0.5, description="s, from measuring to arrival")
    clock: float = Field(default=0.0, ge=-1e6, le=1e6, description="s, the robot's clock is ahead of this host's")
    pressed: Windows = Field(
        default=(), description="s, [from, to] pairs in world time during which the robot's e-stop is pressed"
    )


class FakeBase(SampledFake):
    """Measures the odometry of the part's wheels and drives the base.

    A command stays in force until the next one, or for half a second. `obey` and `watch` are the base itself, used
    by the fake and the twin.
    """

    Options = FakeBaseOptions
    real = MobileBase
    config: BaseConfig

    def __init__(self, name: str, config: BaseConfig, world: World, options: FakeBaseOptions) -> None:
        super().__init__(name, config, world, options)
        self._config, self._options = config, options
        self.clock = options.clock
        top = self.limits[COMMAND].velocity
        assert top is not None
        self._top = top.tolist()
        self.base = self.cell.part(SummitXlPart, name, options.part)
        self.noise_scale = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        self._obeyed = -WATCHDOG  # world time of the newest command, ns
        self._pose, self._twist = np.zeros(3), np.zeros(3)
        self._taken = 0
        self._driven = False  # a command of the loop is in force
        self.sampled(6, self._measure)

    def read(self, now: int) -> None:
        super().read(now)
        if self.watch() and self._driven:
            self._publish_zero()
        self.health.fault = PRESSED if self.pressed() else ""
        age = min((self.world.time - self._taken) * 1e-9, FARTHEST) if self._config.extrapolate else 0.0
        self.state_arrays["pose"][:] = protocol.carried(self._pose, self._twist, age)

    def write(self, now: int) -> None:
        self.check_there()
        values = self.command_arrays[COMMAND].tolist()
        if isfinite(sum(values)):
            sent = [t if v > t else -t if v < -t else v for v, t in zip(values, self._top, strict=True)]
            self.sent_arrays[COMMAND][:] = sent
            self.obey(*sent)
            self._driven = True

    def stop(self, category: Stop) -> None:
        self.base.command(0.0, 0.0, 0.0)
        self._publish_zero()

    def _publish_zero(self) -> None:
        self.sent_arrays[COMMAND][:] = 0.0
        self._driven = False

    def close(self) -> None:
        if self.health.connected:
            self.base.command(0.0, 0.0, 0.0)
        super().close()

    def fill(self, values: Array, number: int) -> None:
        self._pose, self._twist, self._taken = values[:3], values[3:], self.taken_at(number)
        self.state_arrays["twist"][:] = self._twist

    # -- the base itself

    def obey(self, vx: float, vy: float, wz: float) -> None:
        """Takes a velocity command (m/s, m/s, rad/s); the robot's controller limits it."""
        self._obeyed = self.world.time
        if self.pressed():
            vx = vy = wz = 0.0
        vx, vy = min(max(vx, -TOP_SPEED), TOP_SPEED), min(max(vy, -TOP_SPEED), TOP_SPEED)
        self.base.command(vx, vy if self._config.sideways else 0.0, min(max(wz, -TOP_TURN), TOP_TURN))

    def watch(self) -> bool:
        """Applies the robot's own time-out and its emergency stop; must be called often.

        Returns whether the base stopped by its time-out.
        """
        silent = self.world.time - self._obeyed > WATCHDOG
        if self.pressed() or silent:
            self.base.command(0.0, 0.0, 0.0)
        return silent

    def pressed(self) -> bool:
        """Whether the emergency stop is pressed now."""
        return inside(self._options.pressed, self.world.time)

    def _measure(self) -> Array:
        return np.concatenate(self.base.odometry())
