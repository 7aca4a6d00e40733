"""The cell's part `object`: something to grasp, a box, sphere or cylinder, or one of the YCB objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, Self, cast
from xml.etree.ElementTree import Element

import mujoco
from pydantic import Field, model_validator

from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.sim.parts.hand.ycb import YCB, Shape, add_shape
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_SIZES: Final = {"box": 3, "sphere": 1, "cylinder": 2}


class ObjectConfig(PartConfig):
    """One object: either a `shape` with `size` and `mass`, or a YCB `code` that implies its own.

    It stands with the middle of its height.
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

    Its body is `<name>/body`, its geom `<name>/geom`. Truth: `<name>_position` (3,), m, of its centre in the world, and
    `<name>_pose` (7,), m and w x y z.
    """

    Config: ClassVar[type[PartConfig]] = ObjectConfig
    summary = "something to grasp: a box, sphere, cylinder or YCB object, held in place until it is released"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(ObjectConfig, config)
        self.truth = (
            Signal(name=f"{name}_position", shape=(3,), unit="m", labels=POINT, visual="points"),
            Signal(name=f"{name}_pose", shape=(7,), unit="m", labels=POSE),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        ycb = YCB[config.code] if config.code is not None else None
        shape, size = (ycb.shape, ycb.size) if ycb else (cast(Shape, config.shape), config.size)
        mass, friction = (ycb.mass, ycb.friction) if ycb else (config.mass or 0.0, 0.8)
        body = mjcf.body(parent, f"{name}/body", **self.at())
        if config.held_until is not None:
            self.moves_freely(mjcf, parent)
            add(body, "freejoint", name=f"{name}/joint")
            if config.held_until > 0:
                held = {"name": f"{name}/held", "body1": f"{name}/body"}
                add(mjcf.equality, "weld", **held, anchor=self.stand[:3], solref=(0.004, 1.0))
        if ycb is not None:
            add(body, "inertial", pos=(0.0, 0.0, ycb.centre), mass=mass, diaginertia=ycb.inertia)
        add_shape(
            mjcf,
            body,
            name,
            shape,
            size,
            mass=mass,
            # The sheets give the object's friction for a pair of materials, so it overrides that of skin and pads.
            priority=1,
            condim=4,
            friction=(config.friction or friction, 0.005, 0.0001),
            solref=(ycb.softness if ycb else 0.02, 1.0),
            rgba="0.75 0.35 0.3 1",
            **CONTACT["object"],
        )

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data, self._body = model, data, int(model.body(f"{self.name}/body").id)
        self._weld: int | None = None
        if self._config.held_until:
            self._weld = int(model.equality(f"{self.name}/held").id)
            self._release = round(self._config.held_until / model.opt.timestep)

    def put(self, pose: Pose) -> None:
        """Puts a free object elsewhere, at rest: what an experimenter does between two trials.

        Args:
            pose: in the world, x y z (m), w x y z.
        """
        joint = self._model.joint(f"{self.name}/joint")
        at, speed = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._data.qpos[at : at + 7], self._data.qvel[speed : speed + 6] = pose, 0.0
        mujoco.mj_kinematics(self._model, self._data)

    def latch(self, step: int) -> int | None:
        """Releases the object when it is time; returns the step of the release."""
        if self._weld is None:
            return None
        self._data.eq_active[self._weld] = step < self._release
        return self._release if step < self._release else None

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose = truth[f"{self.name}_pose"]
        pose[:3], pose[3:] = self._data.xpos[self._body], self._data.xquat[self._body]
        truth[f"{self.name}_position"][:] = pose[:3]
