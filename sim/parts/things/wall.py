"""A wall of stated stiffness, or a cart: what a robot's tool is pressed against, at one point and without friction."""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign
from typing import Any, ClassVar, cast

import numpy as np
from pydantic import Field, model_validator

from srl.runtime.contracts.per_element import Finite
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE
from srl.sim.parts.things.point_force import PointForceConfig, PointForcePart
from srl.sim.world.part import PartConfig

_DIRECTION = 1e-9  # the least length that says one


class WallConfig(PointForceConfig):
    """Options of the wall. It stands in the world, `gap` away from where the touching point is at the start."""

    touches: str = Field(description="the body that can touch it, PART/BODY")
    normal: tuple[Finite, Finite, Finite] = Field((1.0, 0.0, 0.0), description="out of the wall, world axes")
    gap: float = Field(0.1, ge=0, description="m, to the point at the start, against the normal")
    stiffness: float = Field(1e4, gt=0, le=2e5, description="N/m")
    damping: float = Field(50.0, ge=0, le=1000, description="N s/m, while it is touched; it never pulls")
    mass: float | None = Field(None, gt=0, description="kg of a cart that rolls along the normal; null: it stands")
    resistance: float = Field(0.0, ge=0, description="N, of rolling")

    @model_validator(mode="after")
    def _faces(self) -> WallConfig:
        if sum(v * v for v in self.normal) < _DIRECTION**2:
            raise ValueError("the normal needs a length")
        return self


class WallPart(PointForcePart):
    """A plane that pushes one point of a body out of itself: a spring and a damper.

    MuJoCo's own contacts have a time constant instead of a stiffness, so their N/m depend on what touches.

    Truth: `<name>_force` (3,) N on the body, world axes; `<name>_moved` (2,) m and m/s, of a cart along the normal;
    `<name>_work` (1,) J that it has given to the body, less what it took.
    """

    Config: ClassVar[type[PartConfig]] = WallConfig
    option, stands = "touches", "stands in the world"
    summary = "a wall of stated stiffness (N/m), or a cart, for one point of a body"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(WallConfig, config)
        self.truth = (
            Signal(name=f"{name}_force", shape=(3,), unit="N", labels=FORCE),
            Signal(name=f"{name}_moved", shape=(2,), unit="m, m/s", labels=("way", "speed")),
            Signal(name=f"{name}_work", shape=(1,), unit="J"),
        )
        self.every = 1
        self._normal = np.array(config.normal) / np.linalg.norm(config.normal)
        self._place = self._speed = 0.0  # of a cart, m and m/s
        self._height = float("nan")  # m, of the point above the plane, a step ago
        self._force = np.zeros(3)
        self._at = self._before = self._work = 0.0  # m, the point along the normal now and a step ago; J

    def bind(self, model: Any, data: Any) -> None:
        super().bind(model, data)
        self._at = self._before = float(self._normal @ self.find_point())
        self._zero = self._at - self._config.gap

    def drive(self, step: int) -> None:
        config, dt, point = self._config, self._timestep, self.find_point()
        along = float(self._normal @ point)
        # MuJoCo moves a body by its speed after the step; the force's work is that at the mean of before and after.
        self._work += float(self._normal @ self._force) * (along - self._before) / 2
        self._before, self._at = self._at, along
        height = along - self._zero - self._place
        rate = (height - self._height) / dt if np.isfinite(self._height) else 0.0
        self._height = height
        push = max(-config.stiffness * height - config.damping * rate, 0.0) if height < 0.0 else 0.0
        self._force = push * self._normal
        self.push(point, self._force)
        if config.mass is not None:
            speed = self._speed - dt * push / config.mass
            drag = dt * config.resistance / config.mass
            self._speed = 0.0 if abs(speed) <= drag else speed - copysign(drag, speed)
            self._place += dt * self._speed
            self._height -= dt * self._speed

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_force"][:] = self._force
        truth[f"{self.name}_moved"][:] = self._place, self._speed
        truth[f"{self.name}_work"][0] = self._work

    def save(self) -> Array:
        return np.array([self._place, self._speed, self._height, self._at, self._before, self._work, *self._force])

    def restore(self, state: Array) -> None:
        self._place, self._speed, self._height, self._at, self._before, self._work = state[:6].tolist()
        self._force = state[6:].copy()
