"""Objects to grasp: boxes, spheres, cylinders, and the YCB objects of the pick-and-place experiment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Self
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from sim.world.mjcf import CONTACT, add


@dataclass(frozen=True)
class _Ycb:
    shape: Literal["box", "sphere", "cylinder"]
    size: tuple[float, ...]  # m
    mass: float  # kg
    inertia: tuple[float, float, float]  # kg m^2, about the centre of mass
    friction: float  # against a silicone or rubber pad


# Sheet ycb_objects. Cups and the wine glass are cylinders of their greatest diameter, with their own inertia.
_YCB: Final = {
    "A": _Ycb("box", (0.06, 0.06, 0.06), 0.084, (5.04e-5, 5.04e-5, 5.04e-5), 0.9),
    "B": _Ycb("sphere", (0.096,), 0.191, (1.76e-4, 1.76e-4, 1.76e-4), 1.2),
    "C": _Ycb("cylinder", (0.075, 0.25), 0.205, (1.14e-3, 1.14e-3, 1.44e-4), 0.8),
    "D": _Ycb("cylinder", (0.066, 0.101), 0.349, (3.92e-4, 3.92e-4, 1.90e-4), 0.8),
    "E": _Ycb("cylinder", (0.06, 0.062), 0.014, (1.14e-5, 1.14e-5, 1.14e-5), 0.8),
    "F": _Ycb("cylinder", (0.075, 0.068), 0.021, (2.36e-5, 2.36e-5, 2.63e-5), 0.8),
    "G": _Ycb("cylinder", (0.085, 0.072), 0.028, (3.81e-5, 3.81e-5, 4.48e-5), 0.8),
    "H": _Ycb("cylinder", (0.095, 0.076), 0.035, (5.68e-5, 5.68e-5, 6.96e-5), 0.8),
    "I": _Ycb("sphere", (0.075,), 0.068, (3.83e-5, 3.83e-5, 3.83e-5), 0.85),
    "L": _Ycb("cylinder", (0.089, 0.137), 0.133, (2.40e-4, 2.40e-4, 6.45e-5), 0.75),
    "M": _Ycb("box", (0.05, 0.097, 0.082), 0.370, (4.97e-4, 2.84e-4, 3.67e-4), 0.8),
}
_SIZES: Final = {"box": 3, "sphere": 1, "cylinder": 2}


class ObjectConfig(BaseModel):
    """One object: either a `shape` with `size` and `mass`, or a YCB `code` that implies its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    shape: Literal["box", "sphere", "cylinder", "ycb"]
    code: Literal["A", "B", "C", "D", "E", "F", "G", "H", "I", "L", "M"] | None = Field(
        default=None, description="of the YCB object; with shape ycb"
    )
    size: tuple[float, ...] = Field(
        default=(), description="m; box: x, y, z; sphere: diameter; cylinder: diameter, height (along z)"
    )
    mass: float | None = Field(default=None, gt=0, description="kg")
    friction: float | None = Field(
        default=None,
        gt=0,
        description="against the pads of hand and finger; if null the YCB object's, else 0.8",
    )
    position: tuple[float, float, float] = Field(description="m, its centre in frame hand at the start")
    quaternion: tuple[float, float, float, float] = Field(default=(1, 0, 0, 0), description="w, x, y, z")
    held_until: float | None = Field(
        default=0.0, ge=0, description="s, something else holds it in place until then; null: for ever"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.shape == "ycb":
            if self.code is None or self.size or self.mass is not None:
                raise ValueError("a ycb object is given by its code alone, without size and mass")
        elif self.code is not None:
            raise ValueError(f"a code belongs to shape ycb, not to {self.shape}")
        elif len(self.size) != _SIZES[self.shape] or min(self.size) <= 0 or self.mass is None:
            raise ValueError(f"a {self.shape} needs a mass and {_SIZES[self.shape]} positive number(s) as size")
        return self


def add_object(world: Element, equality: Element, name: str, config: ObjectConfig) -> None:
    """Adds a body `name`, with a free joint unless it is held for ever, and a weld that can be released."""
    ycb = _YCB[config.code] if config.code is not None else None
    shape, size = (ycb.shape, ycb.size) if ycb else (config.shape, config.size)
    mass, friction = (ycb.mass, ycb.friction) if ycb else (config.mass or 0.0, 0.8)
    body = add(world, "body", name=name, pos=config.position, quat=config.quaternion)
    if config.held_until is not None:
        add(body, "freejoint", name=name)
        if config.held_until > 0:
            add(equality, "weld", name=name, body1=name, anchor=config.position, solref=(0.004, 1.0))
    if ycb is not None:
        add(body, "inertial", pos="0 0 0", mass=mass, diaginertia=ycb.inertia)
    half = tuple(np.array(size) / 2)
    add(
        body,
        "geom",
        name=name,
        type=shape,
        size=half,
        mass=mass,
        # The sheets give the object's friction for a pair of materials, so it overrides that of skin and pads.
        priority=1,
        condim=4,
        friction=(config.friction or friction, 0.005, 0.0001),
        rgba="0.75 0.35 0.3 1",
        **CONTACT["object"],
    )
