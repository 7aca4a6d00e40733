"""An object of the cell: fixed in place, free to move, or mounted on another part as its load or tool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, Self, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field, model_validator

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE, POSE
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_SIZES: Final = {"box": 3, "sphere": 1, "cylinder": 2}


class BoxConfig(PartConfig):
    """Options of an object."""

    shape: Literal["box", "sphere", "cylinder"] = "box"
    size: tuple[float, ...] = Field(
        description="m; box: x, y, z; sphere: diameter; cylinder: diameter, height (along z)"
    )
    mass: float = Field(default=1.0, gt=0, description="kg, evenly distributed")
    free: bool = Field(default=False, description="whether it can move; else it is fixed to what it is mounted on")
    friction: float = Field(default=0.8, ge=0, description="sliding, against everything")
    stiffness: float = Field(
        default=0.005, gt=0, description="s, time constant of its contacts: smaller is harder, at least 2 time steps"
    )
    touches: bool = Field(default=True, description="whether it can be touched at all")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if len(self.size) != _SIZES[self.shape] or min(self.size) <= 0:
            raise ValueError(f"a {self.shape} needs {_SIZES[self.shape]} positive number(s) as size")
        return self


class BoxPart(Part):
    """A rigid box, sphere or cylinder. Its body is `<name>/body`, its geom `<name>/geom`.

    Truth: `<name>_pose` (7,) x, y, z, qw, qx, qy, qz of its centre, and `<name>_contact_force` (3,), N, the sum of
    all contact forces on it, both in the world's axes.
    """

    Config: ClassVar[type[PartConfig]] = BoxConfig
    summary = "a box, sphere or cylinder: fixed, free, or a load on a robot"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(BoxConfig, config)
        self.truth = (
            Signal(name=f"{name}_pose", shape=(7,), unit="1", labels=POSE),
            Signal(name=f"{name}_contact_force", shape=(3,), unit="N", labels=FORCE),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        body = mjcf.body(parent, f"{name}/body", **self.at())
        if config.free:
            self.moves_freely(mjcf, parent)
            add(body, "freejoint", name=f"{name}/joint")
        add(
            body,
            "geom",
            name=f"{name}/geom",
            type=config.shape,
            size=tuple(v / 2 for v in config.size),
            mass=config.mass,
            priority=1,  # its friction counts, not that of the other geom
            condim=4,
            friction=(config.friction, 0.005, 0.0001),
            solref=(config.stiffness, 1.0),
            rgba="0.75 0.35 0.3 1",
            **CONTACT["object" if config.touches else "none"],
        )

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._body, self._geom = int(model.body(f"{self.name}/body").id), int(model.geom(f"{self.name}/geom").id)

    def pose(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and centre (3,), m, in the world."""
        return self._data.xmat[self._body].reshape(3, 3).copy(), self._data.xpos[self._body].copy()

    def contact_force(self) -> Array:
        """(3,) N, the sum of all contact forces on it, in the world's axes."""
        data, total, wrench = self._data, np.zeros(3), np.empty(6)
        for i in range(data.ncon):
            contact = data.contact[i]
            if self._geom in (contact.geom1, contact.geom2):
                mujoco.mj_contactForce(self._model, data, i, wrench)
                # The contact's x axis points from geom1 to geom2; the force acts on geom2.
                force = contact.frame.reshape(3, 3).T @ wrench[:3]
                total += force if contact.geom2 == self._geom else -force
        return total

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose = truth[f"{self.name}_pose"]
        pose[:3] = self._data.xpos[self._body]
        pose[3:] = self._data.xquat[self._body]
        truth[f"{self.name}_contact_force"][:] = self.contact_force() if self._data.ncon else 0.0
