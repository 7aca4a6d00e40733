"""A chain of axes with Dynamixel servos."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from srl.drivers.dynamixel.models import MODELS, ModelName
from srl.runtime.contracts.signals import Array
from srl.sim.parts.dynamixel.motors import DynamixelMotors
from srl.sim.parts.servo_bus.chain import ServoAxis, ServoChain, ServoChainConfig
from srl.sim.world.part import PartConfig


class AxisConfig(ServoAxis):
    """An axis with a Dynamixel servo."""

    model: ModelName


class DynamixelChainConfig(ServoChainConfig):
    """Options of the chain."""

    axes: dict[str, AxisConfig] = Field(min_length=1, description="from the base to the tip")


class DynamixelChain(ServoChain[DynamixelMotors]):
    """A chain of MX and X servos; see `ServoChain`."""

    Config: ClassVar[type[PartConfig]] = DynamixelChainConfig
    catalogue = MODELS
    summary = "chain of axes with Dynamixel MX and X servos"

    def servos(self, voltage: Array, timestep: float) -> DynamixelMotors:
        return DynamixelMotors([MODELS[model.name] for model in self.models], voltage, timestep)
