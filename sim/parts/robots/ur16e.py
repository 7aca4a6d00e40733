"""The cell's part `ur16e`."""

from __future__ import annotations

from typing import Annotated, ClassVar

from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.models.robots import UR16E
from srl.sim.parts.robots.arm import HOME, ArmConfig, ArmPart
from srl.sim.world.part import PartConfig


class Ur16eConfig(ArmConfig):
    """Options of a UR16e."""

    home: Annotated[tuple[Finite, ...], PerElement(UR16E.labels)] | None = HOME


class Ur16ePart(ArmPart):
    """Universal Robots' arm; its base frame is the controller's `base`."""

    Config: ClassVar[type[PartConfig]] = Ur16eConfig
    summary = "Universal Robots UR16e, six joints, 16 kg"
    robot = UR16E
