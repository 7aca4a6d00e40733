"""The cell's part `object`: something to grasp, a box, sphere or cylinder, or one of the YCB objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, Self, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field, model_validator

from runtime.contracts.signals import Array, Signal
from runtime.contracts.terms import POINT
from sim.world.mjcf import CONTACT, add
from sim.world.part import Mjcf, Part, PartConfig


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


class ObjectConfig(PartConfig):
    """One object: either a `shape` with `size` and `mass`, or a YCB `code` that implies its own.

    It stands with its centre.
    """

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


class ObjectPart(Part):
    """An object that falls, after something else has held it in place until `held_until`.

    Its body is `<name>/body`, its geom `<name>/geom`. Truth: `<name>_position` (3,), m, of its centre in the world.
    """

    Config: ClassVar[type[PartConfig]] = ObjectConfig
    summary = "something to grasp: a box, sphere, cylinder or YCB object, held in place until it is released"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(ObjectConfig, config)
        self.truth = (Signal(name=f"{name}_position", shape=(3,), unit="m", labels=POINT, visual="points"),)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        ycb = _YCB[config.code] if config.code is not None else None
        shape, size = (ycb.shape, ycb.size) if ycb else (config.shape, config.size)
        mass, friction = (ycb.mass, ycb.friction) if ycb else (config.mass or 0.0, 0.8)
        body = mjcf.body(parent, f"{name}/body", **self.at())
        if config.held_until is not None:
            self.moves_freely(mjcf, parent)
            add(body, "freejoint", name=f"{name}/joint")
            if config.held_until > 0:
                held = {"name": f"{name}/held", "body1": f"{name}/body"}
                add(mjcf.equality, "weld", **held, anchor=self.stand[:3], solref=(0.004, 1.0))
        if ycb is not None:
            add(body, "inertial", pos="0 0 0", mass=mass, diaginertia=ycb.inertia)
        add(
            body,
            "geom",
            name=f"{name}/geom",
            type=shape,
            size=tuple(np.array(size) / 2),
            mass=mass,
            # The sheets give the object's friction for a pair of materials, so it overrides that of skin and pads.
            priority=1,
            condim=4,
            friction=(config.friction or friction, 0.005, 0.0001),
            rgba="0.75 0.35 0.3 1",
            **CONTACT["object"],
        )

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._body = data, int(model.body(f"{self.name}/body").id)
        self._weld: int | None = None
        if self._config.held_until:
            self._weld = int(model.equality(f"{self.name}/held").id)
            self._release = round(self._config.held_until / model.opt.timestep)

    def latch(self, step: int) -> int | None:
        """Releases the object when it is time; returns the step of the release."""
        if self._weld is None:
            return None
        self._data.eq_active[self._weld] = step < self._release
        return self._release if step < self._release else None

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_position"][:] = self._data.xpos[self._body]
