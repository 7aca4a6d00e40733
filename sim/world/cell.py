"""The world `cell`: a scene composed of the parts that the profile lists."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from itertools import accumulate
from typing import Annotated, Any, Final, TypeVar
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainValidator, ValidationInfo

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import WiringError, nearest, refused
from srl.runtime.contracts.frames import IDENTITY, Frames, as_pose
from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.rotation import Pose, composed
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World, WorldConfig
from srl.sim.world import standing
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.samples import Samples

P = TypeVar("P", bound=Part)
_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION


def _part_entry(entry: Any, info: ValidationInfo) -> tuple[type[Part], PartConfig]:
    """Converts a profile entry `{part: KIND, ...}` into the part's class and its checked options."""
    if not isinstance(entry, Mapping) or not isinstance(entry.get("part"), str):
        raise ValueError(f"needs 'part: KIND'; kinds: {', '.join(registry.names('parts'))}")
    cls: type[Part] = registry.load("parts", entry["part"], "sim.parts")
    own = {key: value for key, value in entry.items() if key != "part"}
    return cls, cls.Config.model_validate(own, context=info.context)


class CellConfig(WorldConfig):
    """Options of the world."""

    timestep: float = Field(default=0.001, ge=1e-5, le=0.005, description="s, of the physics; a whole number of ns")
    gravity: tuple[float, float, float] = Field(default=DOWN, description="m/s^2")
    noslip: int = Field(
        default=0, ge=0, le=20, description="iterations that keep what is held from creeping; 5 do, and take time"
    )
    floor: bool = Field(default=False, description="a floor at z = 0 that parts touch")
    duration: float | None = Field(default=None, gt=0, description="s until the run ends by itself")
    ends_with: str | None = Field(default=None, description="a person: the run ends when the plan does")
    parts: dict[str, Annotated[Any, PlainValidator(_part_entry)]] = Field(min_length=1)


class Cell(World):
    """Steps MuJoCo, calls the parts before their steps and takes the sensors' samples when they are due.

    Attributes:
        parts: the parts by name, in the order of the profile.
        model, data: the MuJoCo model and data; positions in `data` belong to the present step.
        step: number of physics steps done.
        timestep: length of a physics step, ns.
    """

    Config = CellConfig
    summary = "a scene composed of parts: arms, a mobile base, hands, sensors, a person, things"

    def __init__(self, config: CellConfig, seed: int, frames: Frames | None = None) -> None:
        super().__init__(config, seed, frames)
        self.parts: dict[str, Part] = {}
        for name, (cls, options) in config.parts.items():
            try:
                self.parts[name] = part = cls(name, options, seed)
            except ValueError as error:
                problem, remedy = refused(error)
                raise WiringError(f"sim.parts.{name}", f"{cls.__name__} can't be made: {problem}", remedy) from error
            refuse_old_names(part, {"doubts": "warnings"})
            self.warnings += [(f"parts.{name}.{key}", text) for key, text in part.warnings]
            self.remarks += [(f"parts.{name}.{key}", text) for key, text in part.remarks]
        ends = [part.ends for part in self.parts.values() if part.ends is not None]
        self.duration = config.duration or max(ends, default=None)
        document, self._carried = _document(config, self.parts, self.frames)
        self.model = mujoco.MjModel.from_xml_string(document)
        self.data = mujoco.MjData(self.model)
        self.timestep = round(config.timestep * 1e9)
        self.step = 0
        self._settled = [-1.0]
        for part in self.parts.values():
            part.settled = self._settled
            part.bind(self.model, self.data)
        wearers = [wearer for part in self.parts.values() if (wearer := getattr(part, "wearer", None)) is not None]
        self.wearer = wearers[0] if len(wearers) == 1 else None
        mujoco.mj_forward(self.model, self.data)
        self.scenery = _scenery(self.model, self.data)
        self._planner = self._ending(config.ends_with)
        self._driven = [part for part in self.parts.values() if part.every]
        self._latching = [part for part in self.parts.values() if type(part).latch is not Part.latch]
        self._samples: list[Samples] = []
        self.truth = tuple(signal for part in self.parts.values() for signal in part.truth)
        self.bind({signal.name: np.zeros(signal.shape) for signal in self.truth})

    def bind(self, truth: Mapping[str, Array]) -> None:
        super().bind(truth)
        for part in self.parts.values():
            part.fill(truth)

    def part(self, kind: type[P], device: str, named: str | None = None) -> P:
        """Returns the part that simulates a device.

        That is the part `named`, if given; else the part with the device's name; else the only part of this kind.

        Raises:
            WiringError: there is no such part, or there is more than one.
        """
        place = f"sim.devices.{device}.part"
        fitting = {name: part for name, part in self.parts.items() if isinstance(part, kind)}
        if named is not None:
            if named not in fitting:
                raise WiringError(place, f"the cell has no {kind.__name__} called '{named}'", nearest(named, fitting))
            return fitting[named]
        if device in fitting:
            return fitting[device]
        if len(fitting) != 1:
            found = f"{len(fitting)} of them ({', '.join(fitting)})" if fitting else "none"
            raise WiringError(
                place,
                f"'{device}' needs one part of kind {kind.__name__}, the cell has {found}",
                "Name one with 'part:'" if fitting else "Add one under sim.parts",
            )
        return next(iter(fitting.values()))

    def pose_of(self, frame: str) -> Pose:
        """Where a frame of the profile is in the world now: x y z (m), w x y z."""
        pose, at = IDENTITY, frame
        while at not in self._carried:
            entry = self.frames.entries[at]
            pose = composed(entry.placed(), pose)
            if entry.parent is None:
                return pose
            at = entry.parent
        name, inside = self._carried[at]
        body = self.data.body(name)
        return composed(as_pose(np.concatenate([body.xpos, body.xquat])), composed(inside, pose))

    def sample(self, rate: Fraction, take: Callable[[], Array], size: int) -> Samples:
        """Starts sampling a sensor at multiples of 1 / rate; the values are kept for a second.

        Args:
            rate: sampling rate, Hz.
            take: returns the present true values, (size,).
            size: number of values in a sample.
        """
        samples = Samples(rate, take, size)
        while samples.taken_at(samples.taken + 1) < self.time:
            samples.taken += 1
        self._samples.append(samples)
        self._take()
        return samples

    def advance(self, until: int) -> None:
        goal, timestep = until // self.timestep, self.timestep
        settled = False
        while self.step < goal:
            step = self.step
            stop = goal
            for part in self._driven:
                if step % part.every == 0:
                    part.drive(step)
                stop = min(stop, step - step % part.every + part.every)
            for part in self._latching:
                if (due := part.latch(step)) is not None:
                    stop = min(stop, due)
            for samples in self._samples:
                stop = min(stop, max(-(-samples.due // timestep), step + 1))
            mujoco.mj_step(self.model, self.data, stop - step)
            self.step = stop
            settled = self._take()
        self.time = max(self.time, until)
        if not settled:
            self._settle()
        for part in self.parts.values():
            part.fill(self.truth_arrays)
        if self._planner is not None:
            self.finished = self._planner.done

    def _ending(self, name: str | None) -> Any:
        """The part whose plan ends the run."""
        if name is None:
            return None
        planners = {key: part for key, part in self.parts.items() if hasattr(part, "done")}
        if name not in planners:
            raise WiringError("sim.ends_with", f"there is no person '{name}'", nearest(name, planners))
        return planners[name]

    def save(self) -> NDArray[np.float64]:
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        truth = [self.truth_arrays[signal.name].ravel() for signal in self.truth]
        own = [part.save() for part in self.parts.values()] + [samples.save() for samples in self._samples]
        head = np.array([self.time, self.step, *(values.size for values in own)], dtype=float)
        return np.concatenate([head, physics, *truth, *own])

    def restore(self, state: NDArray[np.float64]) -> None:
        keepers: list[Any] = [*self.parts.values(), *self._samples]
        first = 2 + len(keepers)
        sizes = [first, mujoco.mj_stateSize(self.model, _STATE), *(s.size for s in self.truth)]
        sizes += [int(size) for size in state[2:first]]
        head, physics, *rest = np.split(state, list(accumulate(sizes))[:-1])
        self.time, self.step = int(head[0]), int(head[1])
        mujoco.mj_setState(self.model, self.data, physics, _STATE)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, physics, _STATE)  # forward has changed the solver's warm start
        self._settled[0] = -1.0
        for signal, values in zip(self.truth, rest, strict=False):
            self.truth_arrays[signal.name][...] = values.reshape(signal.shape)
        # Last: the forces of the step before the state can't be recomputed, so the parts restore their own.
        for keeper, values in zip(keepers, rest[len(self.truth) :], strict=True):
            keeper.restore(values)

    def _take(self) -> bool:
        """Takes the samples that are due; returns whether it has settled positions for that."""
        now = self.step * self.timestep
        settled = False
        for samples in self._samples:
            if samples.due > now:
                continue
            if not settled:
                self._settle()
                settled = True
            while samples.due <= now:
                samples.take()
        return settled

    def _settle(self) -> None:
        """Recomputes positions: after a step, those of bodies and sites are one step behind the joints."""
        mujoco.mj_kinematics(self.model, self.data)
        self._settled[0] = self.data.time


def _scenery(model: Any, data: Any) -> list[dict[str, Any]]:
    """The geoms of all fixed bodies, without planes."""
    kinds = {mujoco.mjtGeom.mjGEOM_BOX: "box", mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
             mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule", mujoco.mjtGeom.mjGEOM_SPHERE: "sphere"}  # fmt: skip
    found = []
    for geom in range(model.ngeom):
        kind = kinds.get(int(model.geom_type[geom]))
        if kind is None or model.body_weldid[model.geom_bodyid[geom]] != 0:
            continue
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
        values = {"size": model.geom_size[geom], "position": data.geom_xpos[geom], "quaternion": turn}
        part = model.body(model.geom_bodyid[geom]).name.partition("/")[0]
        found.append(
            {"kind": kind, "part": part, "colour": model.geom_rgba[geom].tolist()}
            | {k: v.tolist() for k, v in values.items()}
        )
    return found


def _document(config: CellConfig, parts: dict[str, Part], frames: Frames) -> tuple[str, dict[str, tuple[str, Pose]]]:
    """The MJCF document, and the body that carries each frame, with the frame's pose in it."""
    mjcf = Mjcf()
    root = Element("mujoco", model="cell")
    add(root, "compiler", angle="radian", autolimits=True)
    physics = {"integrator": "implicitfast", "cone": "elliptic", "impratio": 10.0}  # low ratios let held objects creep
    add(root, "option", timestep=config.timestep, gravity=config.gravity, noslip_iterations=config.noslip, **physics)
    size = SubElement(root, "visual")
    add(size, "map", znear=0.01)
    add(mjcf.worldbody, "light", pos="0 -1 3", dir="0 0.3 -1", directional=True)
    if config.floor:
        add(mjcf.worldbody, "geom", name="floor", type="plane", size=(10.0, 10.0, 0.1), rgba="0.8 0.8 0.8 1")
    standing.build(mjcf, parts, frames)
    carried = {name: (str(body.get("name")), inside) for name, (body, inside) in mjcf.carried.items()}
    carried |= {name: (name, IDENTITY) for name in mjcf.bodies}
    sections = (mjcf.asset, mjcf.worldbody, mjcf.tendon, mjcf.equality, mjcf.contact, mjcf.actuator, mjcf.sensor)
    root.extend(sections)
    return tostring(root, encoding="unicode"), carried
