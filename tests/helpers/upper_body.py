"""A cell with a simulated wearer, and a steady one for checks of geometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.body.upper_body import UpperBodyPart
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
STEADY = {"wander": 0.0, "wander_turn": 0.0, "direction_error": 0.0, "noise": 0.0}
POINT = (0.24, -0.19, -0.12)  # m, in the chest's frame, about the middle of a right arm's workspace


def cell(seed: int = 1, parts: dict[str, Any] | None = None, **options: Any) -> tuple[Cell, UpperBodyPart]:
    """A world with a part `wearer`, whose jugular notch is 1.1 m up, and others."""
    own = {"part": "upper-body", "at": {"position": [0.1, -0.2, 1.1]}} | options
    world = Cell(CellConfig.model_validate({"parts": {"wearer": own} | (parts or {})}), seed)
    part = world.parts["wearer"]
    assert isinstance(part, UpperBodyPart)
    return world, part


def run(world: Cell, seconds: float, step: int = 10) -> dict[str, Array]:
    """The wearer's truth over some time, a row each `step` ms."""
    names = ("position", "hand", "markers", "dofs", "leak")
    rows: dict[str, list[Array]] = {name: [] for name in names}
    for _ in range(round(seconds * 1000 / step)):
        world.advance(world.time + step * MS)
        for name in names:
            rows[name].append(world.truth_arrays[f"wearer_{name}"].copy())
    return {name: np.array(values) for name, values in rows.items()}
