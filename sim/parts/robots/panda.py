"""The cell's part `panda`."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, cast

from pydantic import Field

from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.models.robots import FR3, PANDA
from srl.sim.parts.robots.arm import HOME, ArmConfig, ArmPart
from srl.sim.world.part import PartConfig


class PandaConfig(ArmConfig):
    """Options of a Panda."""

    home: Annotated[tuple[Finite, ...], PerElement(PANDA.labels)] | None = HOME
    damping: float = Field(default=0.0, ge=0, description="N m s/rad of each joint, besides its friction")
    friction: float = Field(
        default=1.0, ge=0, le=1, description="share of the published friction, which is what torque control leaves"
    )
    robot: Literal["panda", "fr3"] = Field(default="panda", description="which of Franka's arms: limits differ")


class PandaPart(ArmPart):
    """Franka's arm without its hand; its link parameters reproduce torques, not the distribution of mass."""

    Config: ClassVar[type[PartConfig]] = PandaConfig
    summary = "Franka Emika Panda or FR3, seven joints, 3 kg"
    robot = PANDA

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        if cast(PandaConfig, config).robot == "fr3":
            self.robot = FR3  # type: ignore[misc]  # this one's own
        super().__init__(name, config, seed)
