"""A Franka arm's options in the profile, its signals, and the settings sent once before it moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from srl.drivers.panda.requests import Body, SetCollisionBehavior, SetJointImpedance, SetLoad
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.per_element import Finite, PerElement, Positive
from srl.runtime.contracts.signals import Command, Kind, Signal, Stop
from srl.runtime.contracts.terms import POINT, POSE, WRENCH

JOINTS = tuple(f"joint{i}" for i in range(1, 8))
STATES = ("position", "velocity", "effort", "desired_effort", "external_effort", "wrench", "pose", "success_rate")
COMMANDS = ("torque_command", "velocity_command", "position_command")

_Torques = Annotated[tuple[Positive, ...], PerElement(JOINTS, single=True)]
_Forces = Annotated[tuple[Positive, ...], PerElement(WRENCH, single=True)]
_Stiffness = Annotated[float, Field(ge=0, le=14250)]


class Collision(BaseModel):
    """Forces and torques above which the robot stops with a reflex, or reports a contact."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    torque: _Torques = Field(description="N m, of each joint: a reflex")
    force: _Forces = Field(description="N and N m (x, y, z, about x, y, z): a reflex")
    contact_torque: _Torques | None = Field(None, description="N m: a contact; as torque if left out")
    contact_force: _Forces | None = Field(None, description="N, N m: a contact; as force if left out")

    def request(self) -> SetCollisionBehavior:
        """Returns the request, with the same thresholds whether the arm accelerates or not."""
        torque, force = self.torque, self.force
        contact = torque if self.contact_torque is None else self.contact_torque
        touch = force if self.contact_force is None else self.contact_force
        return SetCollisionBehavior(contact, torque, contact, torque, touch, force, touch, force)


class Load(BaseModel):
    """The load at the flange, without the end effector of the robot's own settings."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mass: float = Field(ge=0, allow_inf_nan=False, description="kg")
    centre: Annotated[tuple[Finite, Finite, Finite], PerElement(POINT)] = Field(
        (0.0, 0.0, 0.0), description="m, in the flange's frame"
    )
    inertia: Annotated[tuple[Finite, ...], PerElement(("xx", "yy", "zz", "xy", "xz", "yz"), ordered=False)] = Field(
        (1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0), description="kg m^2 about the centre"
    )

    def request(self) -> SetLoad:
        """Returns the request, with the whole inertia matrix."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return SetLoad(self.mass, self.centre, (xx, xy, xz, xy, yy, yz, xz, yz, zz))


class PandaConfig(DeviceConfig):
    """Options of a Franka arm."""

    gone: ClassVar[Mapping[str, str]] = {"frame": "the frame of an arm's base has the device's name"}

    port: str = Field(description="tcp://HOST:1337 of the controller")
    interface: Literal["torque", "velocity", "position", "none"] = Field(
        "torque", description="what the joints are commanded in; none: the arm is only read, and nothing is set in it"
    )
    collision: Collision | None = Field(None, description="thresholds of contact and reflex; as set before if left out")
    joint_impedance: Annotated[tuple[_Stiffness, ...], PerElement(JOINTS, single=True)] | None = Field(
        None, description="N m/rad, of the robot's own controller (velocity and position)"
    )
    load: Load | None = Field(
        None,
        description="what the flange carries besides the end effector; left out: nothing, else the robot is refused",
    )
    end_effector: float | None = Field(
        None, ge=0, le=50, description="kg, as set in Desk; another is refused. None: it isn't compared"
    )

    @field_validator("port")
    @classmethod
    def _is_tcp(cls, port: str) -> str:
        if "tcp://" not in port:
            raise ValueError(f"'{port}' isn't tcp://HOST:PORT; a robot listens on port 1337")
        return port

    @property
    def kind(self) -> Kind:
        """The quantity that the interface commands; of `none`, that of a motion which never begins."""
        return Kind.TORQUE if self.interface == "none" else Kind(self.interface)

    def settings(self) -> tuple[Body, ...]:
        """Returns the requests that apply the options; the robot accepts them only while idle."""
        found: list[Body] = []
        if self.interface == "none":
            return ()
        if self.collision is not None:
            found.append(self.collision.request())
        if self.joint_impedance is not None:
            found.append(SetJointImpedance(self.joint_impedance))
        if self.load is not None:
            found.append(self.load.request())
        return tuple(found)


FURTHEST, FASTEST = 5.0, 15.0  # rad, rad/s: beyond any joint's end (4.6) and greatest speed (5.3), of Panda and FR3
FORCE = np.array([500.0] * 3 + [100.0] * 3)  # N, N m: more than the arm stands
WINDOW = 0.1  # rad: its joints are stiff
PERIOD = 0.02  # s: after 20 missing commands the robot itself ends the motion
# The limiter bounds the jerk, which the guard needn't: it follows a change of acceleration within this, in the
# command's unit. A limited torque parts from the guard's at once.
RESOLUTION = {Kind.TORQUE: 1e-6, Kind.VELOCITY: 0.05, Kind.POSITION: 0.01}


def states(config: PandaConfig, name: str) -> tuple[Signal, ...]:
    """Returns the states of the arm called `name`, whose base's frame has its name; see the driver's docstring."""
    return (
        Signal(name="position", shape=(7,), unit="rad", labels=JOINTS, plausible=(-FURTHEST, FURTHEST)),
        Signal(name="velocity", shape=(7,), unit="rad/s", labels=JOINTS, plausible=(-FASTEST, FASTEST)),
        Signal(name="effort", shape=(7,), unit="N m", labels=JOINTS),
        Signal(name="desired_effort", shape=(7,), unit="N m", labels=JOINTS),
        Signal(name="external_effort", shape=(7,), unit="N m", labels=JOINTS),
        Signal(name="wrench", shape=(6,), unit="N, N m", frame=name, labels=WRENCH),
        Signal(name="pose", shape=(7,), unit="m", frame=name, labels=POSE),
        Signal(name="success_rate", shape=(1,), unit="1"),
    )


def commands(config: PandaConfig) -> tuple[Command, ...]:
    """Returns the arm's command, selected by its interface; none of `none`."""
    if config.interface == "none":
        return ()
    unit = {Kind.TORQUE: "N m", Kind.VELOCITY: "rad/s", Kind.POSITION: "rad"}[config.kind]
    stops = (Stop.HOLD, Stop.DAMP, Stop.LIMP) if config.kind is Kind.TORQUE else (Stop.HOLD,)
    made = Command(
        name=f"{config.interface}_command",
        shape=(7,),
        unit=unit,
        labels=JOINTS,
        kind=config.kind,
        feedback="position",
        stops=stops,
        period=PERIOD,
        timeout=PERIOD,
        resolution=RESOLUTION[config.kind],
        window=WINDOW if config.kind is Kind.POSITION else None,
        ordered=True,
    )
    return (made,)
