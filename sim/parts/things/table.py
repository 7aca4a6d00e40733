"""The cell's part `table`: a fixed top with the marks of a pick-and-place task."""

from __future__ import annotations

from typing import ClassVar, Final, cast
from xml.etree.ElementTree import Element

from pydantic import Field

from srl.runtime.contracts.per_element import Finite, Positive
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

Spot2 = tuple[Finite, Finite]
_THICK: Final = 0.03  # m
MARK: Final = 0.05
"""m, half a mark's side, or its radius; ours."""


class TableConfig(PartConfig):
    """Options of the table; it stands with the middle of its upper face, z up."""

    size: tuple[Positive, Positive] = Field(default=(0.8, 0.6), description="m, along x and y; ours")
    start: Spot2 = Field(default=(0.0, -0.15), description="m, from the middle: where things are picked; ours")
    goal: Spot2 = Field(default=(0.0, 0.15), description="m, from the middle: where they are placed; ours")
    friction: float = Field(default=0.4, gt=0, description="of its top against everything; ours: plastic on lacquer")
    rolling: float = Field(default=0.0005, ge=0, description="m, rolling resistance on its top; ours")


class TablePart(Part):
    """A table with the sites `<name>/start` and `<name>/goal`: a green square and a red circle, as in the paper."""

    Config: ClassVar[type[PartConfig]] = TableConfig
    summary = "a table with a start and a goal mark"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(TableConfig, self.config), self.name
        top = mjcf.body(parent, f"{name}/top", **self.at())
        x, y = config.size
        # Rolling resistance is what lets a ball lie still; so the contact has six dimensions here.
        friction = (config.friction, 0.005, config.rolling)
        add(
            top, "geom", name=f"{name}/top", type="box", size=(x / 2, y / 2, _THICK / 2), pos=(0, 0, -_THICK / 2),
            priority=2, condim=6, friction=friction, rgba="0.72 0.6 0.45 1", **CONTACT["object"],
        )  # fmt: skip
        marks = {"start": (config.start, "box", "0.1 0.7 0.2 1"), "goal": (config.goal, "cylinder", "0.8 0.1 0.1 1")}
        for mark, (place, shape, colour) in marks.items():
            size = (MARK, MARK, 0.0005) if shape == "box" else (MARK, 0.0005)
            add(top, "site", name=f"{name}/{mark}", type=shape, pos=(*place, 0.0), size=size, rgba=colour)
