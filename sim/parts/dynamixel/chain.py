"""A chain of axes with MX servos."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from srl.drivers.dynamixel.models import MODELS
from srl.sim.parts.servo_bus.chain import ServoAxis, ServoChain, ServoChainConfig
from srl.sim.parts.servo_bus.motors import Motors
from srl.sim.world.part import PartConfig


class AxisConfig(ServoAxis):
    """An axis with an MX servo."""

    model: Literal["MX-28", "MX-64", "MX-106"]


class DynamixelChainConfig(ServoChainConfig):
    """Options of the chain."""

    axes: dict[str, AxisConfig] = Field(min_length=1, description="from the base to the tip")


class DynamixelChain(ServoChain[Motors]):
    """A chain of MX servos; see `ServoChain`."""

    Config: ClassVar[type[PartConfig]] = DynamixelChainConfig
    catalogue = MODELS
    summary = "chain of axes with Dynamixel MX servos"

    def servos(self, voltage: float, timestep: float) -> Motors:
        return Motors(self.models, voltage, timestep)
