"""A chain of axes, each driven by a bus servo of any maker: fingers, arms, grippers, slides."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Final, Generic, Self, TypeVar, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from srl.drivers.servo_bus.models import Nominal
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.models import ArmsOption
from srl.runtime.models.robot_model import WeighedRobot
from srl.runtime.models.robots import RobotDescription
from srl.runtime.models.skeleton.arms import Side
from srl.sim.parts.servo_bus.drives import Drives
from srl.sim.parts.servo_bus.motors import AMBIENT
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.robot_mjcf import add_chain

Vector = tuple[float, float, float]
_OF_LINKS: Final = frozenset({"axis", "link", "radius", "mass", "lower", "upper"})


D = TypeVar("D", bound=Drives)


class ServoAxis(BaseModel):
    """One axis and the link behind it; `reversed`, `zero` and `m_per_rad` describe how its servo is mounted.

    In a chain that is one of the profile's `srl-arms`, `axis` and `link` come from there. In one of a robot's
    description everything about the links comes from there.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: str = Field(description="the maker's name of its servo")
    axis: Vector = Field((0.0, 0.0, 1.0), description="in the frame of the link before")
    link: Vector = Field((0.08, 0.0, 0.0), description="m, from this axis to the next, or to the tip")
    radius: float = Field(0.015, gt=0, description="m, of the link")
    mass: float = Field(0.05, gt=0, description="kg, of the link without the next servo")
    lower: float = Field(-2.6, description="rad or m, mechanical end stop")
    upper: float = Field(2.6, description="rad or m, mechanical end stop")
    start: float = Field(0.0, description="rad or m, where it stands at the start")
    m_per_rad: float | None = Field(None, gt=0, description="m/rad of a prismatic axis")
    reversed: bool = Field(False, description="the axis grows as the shaft's angle falls")
    zero: float = Field(0.0, description="rad, the shaft's angle where the axis is at 0")

    @property
    def scale(self) -> float:
        """Motion of the axis per motion of the shaft, with its sign."""
        size = 1.0 if self.m_per_rad is None else self.m_per_rad
        return -size if self.reversed else size


class ServoChainConfig(PartConfig):
    """Options of a chain."""

    axes: Mapping[str, ServoAxis]
    arms: ArmsOption | None = Field(
        default=None,
        description="supernumerary arms under `models:`: the chain is one of them; it stands at their parent",
    )
    side: Side = Field(default="right", description="which of the arms")
    robot: WeighedRobot | None = Field(
        default=None,
        description="an arm, such as one of `models:` from its URDF: the chain has its links and its joints' names",
    )
    voltage: float | None = Field(None, gt=0, description="V, of the supply; none: that for which each is made")
    ambient: float = Field(AMBIENT, description="degC, where the servos begin")

    @model_validator(mode="after")
    def _names_are_free(self) -> Self:
        for name in ("base", "tip", "flange"):
            if name in self.axes:
                problem = f"no axis can be called '{name}': a body of the chain is"
                raise OptionError(problem, "Rename it, in the URDF, too, where it comes from there")
        if self.robot is not None:
            self._fits_robot(self.robot)
        if self.arms is None:
            return self
        joints = self.arms.arms.joints
        if len(joints) != len(self.axes):
            raise OptionError(
                f"the arms have {len(joints)} joints, and these are {len(self.axes)} axes", "Give each one"
            )
        for (name, axis), joint in zip(self.axes.items(), joints, strict=True):
            if given := {"axis", "link"} & axis.model_fields_set:
                raise OptionError(f"{name}: '{min(given)}' is described under `models:`", "Leave it out here")
            if joint.slides != (axis.m_per_rad is not None):
                raise OptionError(
                    f"{name} {'slides' if joint.slides else 'turns'} under `models:`", "Correct 'm_per_rad'"
                )
        return self

    def _fits_robot(self, robot: RobotDescription) -> None:
        if self.arms is not None:
            raise OptionError("'arms' and 'robot' both describe the links", "Give one of them")
        if set(self.axes) != set(robot.labels):
            wrong = sorted(set(self.axes) ^ set(robot.labels))[0]
            raise OptionError(
                f"the axes aren't the joints of {robot.name}, as '{wrong}' shows", f"Name {', '.join(robot.labels)}"
            )
        for name, axis in self.axes.items():
            if given := _OF_LINKS & axis.model_fields_set:
                raise OptionError(f"{name}: '{min(given)}' is described by {robot.name}", "Leave it out here")
            if (name in robot.slides) != (axis.m_per_rad is not None):
                kind = "slides" if name in robot.slides else "turns"
                raise OptionError(f"{name} {kind} in {robot.name}", "Correct 'm_per_rad'")

    @cached_property
    def base(self) -> Vector:
        """m, of the chain's first axis' base where the part stands."""
        return _vector(self.arms.arms.offsets(self.side)[0]) if self.arms is not None else (0.0, 0.0, 0.0)

    @cached_property
    def first(self) -> Vector:
        """m, from the base to the first axis."""
        return _vector(self.arms.arms.offsets(self.side)[1]) if self.arms is not None else (0.0, 0.0, 0.0)

    @cached_property
    def chain(self) -> Mapping[str, ServoAxis]:
        """The axes with their places, from the base on."""
        if self.robot is not None:
            homes = zip(self.robot.labels, self.robot.home.tolist(), strict=True)
            return {
                n: a if "start" in (a := self.axes[n]).model_fields_set else a.model_copy(update={"start": home})
                for n, home in homes
            }
        if self.arms is None:
            return self.axes
        arms = self.arms.arms
        places = zip(self.axes.items(), arms.axes(self.side), arms.offsets(self.side)[2:], strict=True)
        return {
            name: axis.model_copy(update={"axis": _vector(turn), "link": _vector(link)})
            for (name, axis), turn, link in places
        }


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return (x, y, z)


class ServoChain(Part, Generic[D]):
    """A chain with the bodies `NAME/base`, `NAME/AXIS` and `NAME/tip`.

    Links don't touch each other, but they touch hands and objects. A chain of a robot's description also has the body
    `NAME/flange`, where its tip is; its links' masses have those of the servos in them.

    Truth: `NAME_position` (n,) rad (m), `NAME_velocity`, `NAME_effort` (n,) N m (N) of the servos' drives, after
    friction and drag of the motors, `NAME_temperature` (n,) degC, `NAME_tip` (1, 3) m in the world.

    Attributes:
        catalogue: the servos that it can have, by their makers' names.
        motors: the servos, at their shafts.
        names: names of the axes.
        scale: (n,), rad or m of an axis per rad of its shaft.
        zero: (n,), rad.
    """

    catalogue: ClassVar[Mapping[str, Nominal]]

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(ServoChainConfig, config)
        axes = self._config.chain
        self.names, n = tuple(axes), len(axes)
        self.scale = np.array([axis.scale for axis in axes.values()])
        self.zero = np.array([axis.zero for axis in axes.values()])
        self.models = tuple(self.catalogue[axis.model] for axis in axes.values())
        linear = all(axis.m_per_rad is not None for axis in axes.values())
        units = ("m", "m/s", "N") if linear else ("rad", "rad/s", "N m")
        kinds = zip(("position", "velocity", "effort", "temperature"), (*units, "degC"), strict=True)
        self.truth = (
            *(Signal(name=f"{name}_{key}", shape=(n,), unit=unit, labels=self.names) for key, unit in kinds),
            Signal(
                name=f"{name}_tip",
                shape=(1, 3),
                unit="m",
                frame="world",
                labels=("tip",),
                components=(POINT,),
                visual="points",
            ),
        )
        self.every = 1

    @abstractmethod
    def servos(self, voltage: Array, timestep: float) -> D:
        """The servos; `voltage`: (n,) V, `timestep`: s."""

    @property
    def _supplies(self) -> Array:
        """(n,) V."""
        given = self._config.voltage
        return np.array([model.nominal_voltage if given is None else given for model in self.models])

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        drives = self.servos(self._supplies, 1e-3)
        if config.robot is not None:
            joints = {
                axis_name: {
                    "armature": drives.inertia[i] / axis.scale**2,
                    "damping": drives.drag[i] / axis.scale**2,
                    "frictionloss": drives.friction[i] / abs(axis.scale),
                }
                for i, (axis_name, axis) in enumerate(config.chain.items())
            }
            flange = add_chain(mjcf, parent, config.robot, name, joints, at=self.at())
            for axis_name in config.chain:
                add(mjcf.actuator, "motor", name=f"{name}/{axis_name}", joint=f"{name}/{axis_name}")
            add(mjcf.body(flange, f"{name}/tip"), "site", name=f"{name}/tip", size=0.003)
            return
        body = mjcf.body(parent, f"{name}/base", **self.at((*config.base, 1.0, 0.0, 0.0, 0.0)))
        first = self.models[0]
        look = {"rgba": "0.2 0.2 0.22 1", **CONTACT["none"]}
        add(body, "geom", name=f"{name}/base", type="box", size=(0.02, 0.02, 0.025), mass=first.mass, **look)
        place = config.first
        carried = [model.mass for model in self.models[1:]] + [0.0]
        for i, (axis_name, axis) in enumerate(config.chain.items()):
            full = f"{name}/{axis_name}"
            body = mjcf.body(body, full, pos=place)
            scale = abs(axis.scale)
            add(
                body,
                "joint",
                name=full,
                type="hinge" if axis.m_per_rad is None else "slide",
                axis=axis.axis,
                range=(axis.lower, axis.upper),
                armature=drives.inertia[i] / scale**2,
                damping=drives.drag[i] / scale**2,
                frictionloss=drives.friction[i] / scale,
            )
            add(mjcf.actuator, "motor", name=full, joint=full)
            self._add_link(body, full, axis, carried[i])
            place = axis.link
        tip = mjcf.body(body, f"{name}/tip", pos=place)
        add(tip, "site", name=f"{name}/tip", size=0.003)

    def _add_link(self, body: Element, full: str, axis: ServoAxis, carried: float) -> None:
        """Adds the link as a rod, and the next servo at its end."""
        length = float(np.linalg.norm(axis.link))
        if length > 1e-6:
            rod: dict[str, object] = {"type": "capsule", "fromto": (0.0, 0.0, 0.0, *axis.link), "size": axis.radius}
        else:
            rod = {"type": "sphere", "size": axis.radius}
        look = {"rgba": "0.3 0.45 0.7 1", "friction": (1.0, 0.005, 0.0001), **CONTACT["finger"]}
        add(body, "geom", name=full, mass=axis.mass, **rod, **look)
        if carried:
            box = {"type": "box", "pos": axis.link, "size": (0.018, 0.018, 0.025)}
            add(body, "geom", name=f"{full}/servo", mass=carried, rgba="0.2 0.2 0.22 1", **box, **CONTACT["none"])

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        joints = [model.joint(f"{self.name}/{axis}") for axis in self.names]
        self._q = np.array([int(joint.qposadr[0]) for joint in joints])
        self._v = np.array([int(joint.dofadr[0]) for joint in joints])
        self._u = np.array([int(model.actuator(f"{self.name}/{axis}").id) for axis in self.names])
        self._tip = int(model.site(f"{self.name}/tip").id)
        data.qpos[self._q] = [axis.start for axis in self._config.chain.values()]
        self.motors = self.servos(self._supplies, float(model.opt.timestep))
        self.motors.temperature[:] = self._config.ambient
        self.measure()
        for i in range(len(self.names)):
            self.motors.fold(i)
        self._powered = self.motors.torque.copy()

    def measure(self) -> D:
        """Returns the servos, with encoders read now."""
        self.motors.measure(self._data.qpos[self._q] / self.scale + self.zero, self._data.qvel[self._v] / self.scale)
        return self.motors

    def angles(self) -> Array:
        """(n,) rad or m: where the axes are."""
        found: Array = self._data.qpos[self._q].copy()
        return found

    def drive(self, step: int) -> None:
        self._data.ctrl[self._u] = self.measure().step() / self.scale
        if not np.array_equal(self.motors.torque, self._powered):
            self._brake()

    def _brake(self) -> None:
        self._powered[:] = self.motors.torque
        self._model.dof_damping[self._v] = self.motors.drag / self.scale**2

    def fill(self, truth: Mapping[str, Array]) -> None:
        position, velocity, effort, temperature, tip = (truth[signal.name] for signal in self.truth)
        position[:], velocity[:] = self._data.qpos[self._q], self._data.qvel[self._v]
        effort[:] = self.motors.current * self.motors.torque_constant / self.scale
        temperature[:] = self.motors.temperature
        tip[0] = self._data.site_xpos[self._tip]

    def save(self) -> Array:
        return self.motors.save()

    def restore(self, state: Array) -> None:
        self.motors.restore(state)
        self._brake()
