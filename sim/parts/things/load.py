"""Experiment 4 of SUPER-MAN: a load with a grip, and obstacles that must be avoided."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE, POSE
from srl.sim.parts.things.touch import Touches
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_LOOKS: Final = 0.02  # s between two measurements of distances
_GRIPS: Final = 0.01  # s between two checks of the gripper
_FARTHEST: Final = 5.0  # m, beyond which no distance is measured


class LoadConfig(PartConfig):
    """Options of the load; its frame is in its middle."""

    size: tuple[float, float, float] = Field(default=(0.3, 0.2, 0.2), description="m; ours")
    mass: float = Field(default=10.0, gt=0, description="kg; paper")
    grip: float = Field(default=0.15, gt=0, description="m, of the bar above the box: fingers need room; ours")
    friction: float = Field(default=0.8, ge=0, description="of the box on what it stands on")
    gripper: str | None = Field(default=None, description="a softhand part that holds the grip when it closes round it")
    reach: float = Field(default=0.08, gt=0, description="m from the grip to the hollow of the hand, the most; ours")
    hollow: tuple[float, float, float] = Field(
        default=(0.045, 0.0, 0.085), description="m, the middle of the hollow of the hand in the palm's frame; ours"
    )
    closed: float = Field(default=0.9, gt=0, description="rad of the gripper's motor, from which on it holds; ours")


class LoadPart(Part):
    """A free box `<name>/box` with a bar on top, site `<name>/grasp` in the bar's middle.

    The simulated soft hand can't carry 10 kg by friction on a modelled bar. So a hand that has closed near the bar is
    joined to it, in their present relative pose, until it opens. The bar itself can't be touched.

    Truth: `<name>_pose` (7,) x, y, z, qw, qx, qy, qz; `<name>_support` (3,) N, of what the box stands on or hits,
    world axes; `<name>_held` (1,).
    """

    Config = LoadConfig
    summary = "a box of 10 kg with a grip, that a gripper can take and put down"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(LoadConfig, config)
        self.truth = (
            Signal(name=f"{name}_pose", shape=(7,), unit="1", labels=POSE),
            Signal(name=f"{name}_support", shape=(3,), unit="N", labels=FORCE),
            Signal(name=f"{name}_held", shape=(1,), unit="1"),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        config, name = self._config, self.name
        body = mjcf.body(parent, f"{name}/box", **self.at())
        add(body, "freejoint", name=f"{name}/box")
        half, bar = tuple(v / 2 for v in config.size), {"rgba": "0.2 0.2 0.2 1", "mass": 0, **CONTACT["none"]}
        add(
            body, "geom", name=f"{name}/box", type="box", size=half, mass=config.mass, rgba="0.7 0.55 0.35 1",
            priority=1, condim=4, friction=(config.friction, 0.005, 0.0001), **CONTACT["object"],
        )  # fmt: skip
        top = half[2] + config.grip
        for k, y in enumerate((-0.07, 0.07)):
            add(
                body,
                "geom",
                name=f"{name}/post_{k}",
                type="capsule",
                size=0.01,
                fromto=(0, y, half[2], 0, y, top),
                **bar,
            )
        add(body, "geom", name=f"{name}/bar", type="capsule", size=0.012, fromto=(0, -0.07, top, 0, 0.07, top), **bar)
        add(body, "site", name=f"{name}/grasp", pos=(0, 0, top), size=0.002)
        if config.gripper is not None:
            # Welded to the world here, since the gripper may not be built yet; `bind` replaces it by the palm.
            add(mjcf.equality, "weld", name=f"{name}/held", body1=f"{name}/box", active=False, solref=(0.01, 1.0))

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._body, self._site = int(model.body(f"{self.name}/box").id), int(model.site(f"{self.name}/grasp").id)
        timestep = float(model.opt.timestep)
        self.every, self._dt = max(1, round(0.001 / timestep)), max(1, round(0.001 / timestep)) * timestep
        self._grips = max(1, round(_GRIPS / timestep))
        self.touches = Touches(model, data, self.name)
        self._joint = self._weld = -1
        if (gripper := self._config.gripper) is not None:
            bodies = [model.body(i).name for i in range(model.nbody)]
            if f"{gripper}/palm" not in bodies:
                hands = [body.removesuffix("/palm") for body in bodies if body.endswith("/palm")]
                raise WiringError(
                    f"sim.parts.{self.name}.gripper", f"there is no hand '{gripper}'", nearest(gripper, hands)
                )
            self._joint = int(model.joint(f"{gripper}/motor").qposadr[0])
            self._palm = int(model.body(f"{gripper}/palm").id)
            self._weld = int(model.equality(f"{self.name}/held").id)
            model.eq_obj1id[self._weld], model.eq_obj2id[self._weld] = self._palm, self._body

    @property
    def held(self) -> bool:
        """Whether the gripper holds the load."""
        return self._weld >= 0 and bool(self._data.eq_active[self._weld])

    def drive(self, step: int) -> None:
        self.touches.look(self._dt)
        if self._weld < 0 or step % self._grips:
            return
        closed = float(self._data.qpos[self._joint]) > self._config.closed * (0.9 if self.held else 1.0)
        if closed and not self.held and self._within():
            self._take()
        elif not closed and self.held:
            self._data.eq_active[self._weld] = 0

    def _within(self) -> bool:
        data, palm = self._data, self._palm
        mujoco.mj_kinematics(self._model, data)
        hollow = data.xpos[palm] + data.xmat[palm].reshape(3, 3) @ self._config.hollow
        return bool(np.linalg.norm(data.site_xpos[self._site] - hollow) < self._config.reach)

    def _take(self) -> None:
        data, palm, box = self._data, self._palm, self._body
        kept = self._model.eq_data[self._weld]  # anchor (3), pose of the box in the palm (7), torque scale
        back = np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[palm])
        kept[:3] = 0.0
        kept[3:6] = data.xmat[palm].reshape(3, 3).T @ (data.xpos[box] - data.xpos[palm])
        mujoco.mju_mulQuat(back, back.copy(), data.xquat[box])
        kept[6:10] = back
        data.eq_active[self._weld] = 1

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose, data = truth[f"{self.name}_pose"], self._data
        pose[:3] = data.xpos[self._body]
        pose[3:] = data.xquat[self._body]
        truth[f"{self.name}_support"][:] = self.touches.force
        truth[f"{self.name}_held"][0] = self.held

    def save(self) -> Array:
        kept = self._model.eq_data[self._weld] if self._weld >= 0 else np.zeros(11)
        return np.concatenate([self.touches.save(), kept[:11]])

    def restore(self, state: Array) -> None:
        self.touches.restore(state[: Touches.SIZE])
        if self._weld >= 0:
            self._model.eq_data[self._weld, :11] = state[Touches.SIZE :]


class Obstacle(BaseModel):
    """A box that is in the way."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: tuple[float, float, float] = Field(description="m, of its middle in the part's frame")
    size: tuple[float, float, float] = Field(description="m")
    yaw: float = Field(default=0.0, description="rad about z")


class ObstaclesConfig(PartConfig):
    """Options of the obstacles."""

    boxes: tuple[Obstacle, ...] = Field(min_length=1)
    watch: tuple[str, ...] = Field(
        default=(), description="bodies, PART/BODY, whose distance is measured: of the geoms on themselves"
    )


class ObstaclesPart(Part):
    """Boxes `<name>/box_0`, ... fixed to the world.

    Truth: `<name>_distance` (n,) m, of each box to the watched bodies, at most 5 m, negative when they overlap; every
    20 ms. `<name>_touches` (3,): number of touches, whether one is touched now, s of contact.
    """

    Config = ObstaclesConfig
    summary = "boxes that stand in the way; measures distances and counts touches"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(ObstaclesConfig, config)
        n = len(self._config.boxes)
        self.truth = (
            Signal(name=f"{name}_distance", shape=(n,), unit="m", labels=tuple(f"box_{k}" for k in range(n))),
            Signal(name=f"{name}_touches", shape=(3,), unit="1", labels=("count", "now", "seconds")),
        )
        self._distance = np.full(n, _FARTHEST)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        body = mjcf.body(parent, f"{self.name}/all", **self.at())
        for k, box in enumerate(self._config.boxes):
            half = tuple(v / 2 for v in box.size)
            turn = (np.cos(box.yaw / 2), 0.0, 0.0, np.sin(box.yaw / 2))
            add(
                body, "geom", name=f"{self.name}/box_{k}", type="box", pos=box.position, quat=turn, size=half,
                rgba="0.8 0.5 0.2 1", **CONTACT["object"],
            )  # fmt: skip

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        timestep = float(model.opt.timestep)
        self.every, self._dt = max(1, round(0.001 / timestep)), max(1, round(0.001 / timestep)) * timestep
        self._looks = max(1, round(_LOOKS / timestep))
        self.touches = Touches(model, data, self.name)
        self._boxes = [int(model.geom(f"{self.name}/box_{k}").id) for k in range(len(self._config.boxes))]
        bodies = [model.body(i).name for i in range(model.nbody)]
        for named in self._config.watch:
            if named not in bodies:
                raise WiringError(
                    f"sim.parts.{self.name}.watch", f"no body is called '{named}'", nearest(named, bodies)
                )
        watched = {bodies.index(named) for named in self._config.watch}
        self._watched = [i for i in range(model.ngeom) if int(model.geom_bodyid[i]) in watched]

    def drive(self, step: int) -> None:
        self.touches.look(self._dt)
        if step % self._looks or not self._watched:
            return
        mujoco.mj_kinematics(self._model, self._data)
        ends = np.empty(6)
        for k, box in enumerate(self._boxes):
            self._distance[k] = min(
                mujoco.mj_geomDistance(self._model, self._data, box, geom, _FARTHEST, ends) for geom in self._watched
            )

    def fill(self, truth: Mapping[str, Array]) -> None:
        touches = self.touches
        truth[f"{self.name}_distance"][:] = self._distance
        truth[f"{self.name}_touches"][:] = touches.count, touches.touching, touches.spent

    def save(self) -> Array:
        return np.concatenate([self.touches.save(), self._distance])

    def restore(self, state: Array) -> None:
        self.touches.restore(state[: Touches.SIZE])
        self._distance[:] = state[Touches.SIZE :]
