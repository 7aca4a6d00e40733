"""The cell's part `push`: a force on one point of a body, at stated times: a knock, a bystander, a gust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from runtime.contracts.errors import WiringError, nearest
from runtime.contracts.per_element import Finite
from runtime.contracts.signals import Array, Signal
from runtime.contracts.terms import FORCE
from sim.world.part import Mjcf, Part, PartConfig

Window = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]


class PushConfig(PartConfig):
    """Options of the push."""

    pushes: str = Field(description="the body that is pushed, PART/BODY; nothing else pushes the same one")
    point: tuple[Finite, Finite, Finite] = Field((0.0, 0.0, 0.0), description="m, where, in that body")
    force: tuple[Finite, Finite, Finite] = Field(description="N, world axes")
    times: tuple[Window, ...] = Field(description="s, [from, to] pairs in world time")
    rise: float = Field(0.02, gt=0, le=1, description="s in which the force comes, and goes")


class PushPart(Part):
    """A force whose line and size are stated, whatever it pushes at does.

    Truth: `<name>_force` (3,) N on the body, world axes; `<name>_work` (1,) J that it has given to the body.
    """

    Config: ClassVar[type[PartConfig]] = PushConfig
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

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        if parent is not mjcf.worldbody:
            problem = f"'{self.name}' pushes from the world, and can't be mounted on another part"
            raise WiringError(f"sim.parts.{self.name}.at", problem, "Leave `at` out")

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        bodies, pushes = [model.body(i).name for i in range(model.nbody)], self._config.pushes
        if pushes not in bodies:
            place = f"sim.parts.{self.name}.pushes"
            raise WiringError(place, f"no body is called '{pushes}'", nearest(pushes, bodies))
        self._body, self._timestep = bodies.index(pushes), float(model.opt.timestep)

    def drive(self, step: int) -> None:
        config, data, t = self._config, self._data, step * self._timestep
        mujoco.mj_kinematics(self._model, data)  # after a step, bodies are one step behind the joints
        point = data.xpos[self._body] + data.xmat[self._body].reshape(3, 3) @ config.point
        # MuJoCo moves a body by its speed after the step; the force's work is that at the mean of before and after.
        if self._force.any():
            self._work += float(self._force @ (point - self._before)) / 2
        share = max((min(t - start, end - t) / config.rise for start, end in config.times), default=0.0)
        self._before, self._point, self._force = self._point, point, min(max(share, 0.0), 1.0) * np.array(config.force)
        data.xfrc_applied[self._body, :3] = self._force
        data.xfrc_applied[self._body, 3:] = np.cross(point - data.xipos[self._body], self._force)

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_force"][:] = self._force
        truth[f"{self.name}_work"][0] = self._work

    def save(self) -> Array:
        return np.array([self._work, *self._before, *self._point, *self._force])

    def restore(self, state: Array) -> None:
        self._work = float(state[0])
        self._before, self._point, self._force = state[1:4].copy(), state[4:7].copy(), state[7:].copy()
