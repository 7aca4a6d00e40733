"""Dynamixel servos at their shafts: each begins with the gains and limits of its model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from srl.drivers.dynamixel.family import VELOCITY2
from srl.drivers.dynamixel.models import Gains, Model
from srl.runtime.contracts.signals import Array
from srl.sim.parts.servo_bus.motors import Motors

FULL_PWM: Final = 885


class DynamixelMotors(Motors):
    """All servos of a chain; see `Motors`."""

    def __init__(self, models: Sequence[Model], voltage: Array | float, timestep: float) -> None:
        self._own = models
        super().__init__(models, voltage, timestep)

    def power_up(self, i: int) -> None:
        super().power_up(i)
        own = self._own[i]
        self.tune(i, own.gains)
        self.shutdown[i], self.temperature_limit[i] = own.series.shutdown, own.series.temperature

    def tune(self, i: int, gains: Gains) -> None:
        """Sets the gains of motor `i`, given as the registers of protocol 2 have them."""
        self.kp[i] = gains.position_p / 128 / FULL_PWM
        self.ki[i] = gains.position_i / 65536 / FULL_PWM * 1000
        self.kd[i] = gains.position_d / 16 / FULL_PWM * 0.001
        self.velocity_kp[i] = gains.velocity_p / 128 / FULL_PWM / VELOCITY2
        self.velocity_ki[i] = gains.velocity_i / 65536 / FULL_PWM / VELOCITY2 * 1000
