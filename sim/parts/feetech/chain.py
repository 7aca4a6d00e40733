"""A chain of axes with Feetech STS servos, such as the arm SO-101."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from srl.drivers.feetech.models import MODELS
from srl.runtime.contracts.signals import Array
from srl.sim.parts.feetech.motors import FeetechMotors
from srl.sim.parts.servo_bus.chain import ServoAxis, ServoChain, ServoChainConfig
from srl.sim.world.part import PartConfig


class AxisConfig(ServoAxis):
    """An axis with an STS servo."""

    model: Literal["STS3215", "STS3250"]


class FeetechChainConfig(ServoChainConfig):
    """Options of the chain."""

    axes: dict[str, AxisConfig] = Field(min_length=1, description="from the base to the tip")


class FeetechChain(ServoChain[FeetechMotors]):
    """A chain of STS servos; see `ServoChain`."""

    Config: ClassVar[type[PartConfig]] = FeetechChainConfig
    catalogue = MODELS
    summary = "chain of axes with Feetech STS servos"

    def servos(self, voltage: Array, timestep: float) -> FeetechMotors:
        return FeetechMotors(self.models, voltage, timestep)
