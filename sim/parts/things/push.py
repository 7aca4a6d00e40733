"""The cell's part `push`: a force on one point of a body, at stated times: a knock, a bystander, a gust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, cast

import numpy as np
from pydantic import Field

from srl.runtime.contracts.per_element import Finite
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE
from srl.sim.parts.things.point_force import PointForceConfig, PointForcePart
from srl.sim.world.part import PartConfig

Window = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]


class PushConfig(PointForceConfig):
    """Options of the push."""

    pushes: str = Field(description="the body that is pushed, PART/BODY; nothing else pushes the same one")
    force: tuple[Finite, Finite, Finite] = Field(description="N, world axes")
    times: tuple[Window, ...] = Field(description="s, [from, to] pairs in world time")
    rise: float = Field(0.02, gt=0, le=1, description="s in which the force comes, and goes")


class PushPart(PointForcePart):
    """A force whose line and size are stated, whatever it pushes at does.

    Truth: `<name>_force` (3,) N on the body, world axes; `<name>_work` (1,) J that it has given to the body.
    """

    Config: ClassVar[type[PartConfig]] = PushConfig
    option, stands = "pushes", "pushes from the world"
    summary = "a force on one point of a body, at stated times"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(PushConfig, config)
        self.truth = (
            Signal(name=f"{name}_force", shape=(3,), unit="N", labels=FORCE),
            Signal(name=f"{name}_work", shape=(1,), unit="J"),
        )
        self.every = 1
        self._force, self._work = np.zeros(3), 0.0
        self._point, self._before = np.full(3, np.nan), np.full(3, np.nan)  # m, now and a step ago

    def drive(self, step: int) -> None:
        config, t, point = self._config, step * self._timestep, self.find_point()
        # MuJoCo moves a body by its speed after the step; the force's work is that at the mean of before and after.
        if self._force.any():
            self._work += float(self._force @ (point - self._before)) / 2
        share = max((min(t - start, end - t) / config.rise for start, end in config.times), default=0.0)
        self._before, self._point, self._force = self._point, point, min(max(share, 0.0), 1.0) * np.array(config.force)
        self.push(point, self._force)

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_force"][:] = self._force
        truth[f"{self.name}_work"][0] = self._work

    def save(self) -> Array:
        return np.array([self._work, *self._before, *self._point, *self._force])

    def restore(self, state: Array) -> None:
        self._work = float(state[0])
        self._before, self._point, self._force = state[1:4].copy(), state[4:7].copy(), state[7:].copy()
