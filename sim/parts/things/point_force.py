"""What parts share that push one point of another part's body: they stand in the world, and say what they push."""

from __future__ import annotations

from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.per_element import Finite
from srl.runtime.contracts.signals import Array
from srl.sim.world.part import Mjcf, Part, PartConfig


class PointForceConfig(PartConfig):
    """Options of all of them. Each names its body under a word of its own."""

    point: tuple[Finite, Finite, Finite] = Field((0.0, 0.0, 0.0), description="m, where it acts, in that body")


class PointForcePart(Part):
    """A force on one point of one body.

    Attributes:
        option: the option that names the body.
        stands: what it does in the world, in words.
    """

    config: PointForceConfig
    option: ClassVar[str]
    stands: ClassVar[str]

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        """It adds nothing."""
        if parent is not mjcf.worldbody:
            problem = f"'{self.name}' {self.stands}, and can't be mounted on another part"
            raise WiringError(f"sim.parts.{self.name}.at", problem, "Leave `at` out")

    def bind(self, model: Any, data: Any) -> None:
        """Raises WiringError: no body has that name."""
        self._model, self._data = model, data
        bodies, named = [model.body(i).name for i in range(model.nbody)], getattr(self.config, self.option)
        if named not in bodies:
            place = f"sim.parts.{self.name}.{self.option}"
            raise WiringError(place, f"no body is called '{named}'", nearest(named, bodies))
        self._body, self._timestep = bodies.index(named), float(model.opt.timestep)

    def find_point(self) -> Array:
        """Where the point is now, (3,) m, world axes."""
        config, data, body = self.config, self._data, self._body
        mujoco.mj_kinematics(self._model, data)  # after a step, bodies are one step behind the joints
        found: Array = data.xpos[body] + data.xmat[body].reshape(3, 3) @ config.point
        return found

    def push(self, point: Array, force: Array) -> None:
        """Puts a force (3,) N, world axes, on the body at this point (3,) m, for the next step."""
        data, body = self._data, self._body
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = np.cross(point - data.xipos[body], force)
