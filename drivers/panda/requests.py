"""What a client of FCI asks: the bodies of its requests, field by field. How they travel is in `protocol`.

Source: protocol sheet franka-fci, section 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi
from typing import Any


def wire(form: str, since: int = 0, default: Any = None) -> Any:
    """Defines a field of a request: its struct format, and the protocol version that introduced it."""
    metadata = {"form": form, "since": since}
    return field(metadata=metadata) if default is None else field(metadata=metadata, default=default)


@dataclass(frozen=True, slots=True)
class Connect:
    """Opens the session; the robot sends its states to `port` of the same host."""

    version: int = wire("H")
    port: int = wire("H")


@dataclass(frozen=True, slots=True)
class Move:
    """Starts a motion. The robot replies twice: MOTION_STARTED or a refusal, later how the motion ended.

    `controller` is a packets.Controller, `generator` a packets.Generator minus one. A generator for torque alone
    (NONE) exists from protocol 10 on. Deviations: m, rad, rad (elbow).
    """

    controller: int = wire("I")
    generator: int = wire("I")
    path_deviation: tuple[float, ...] = wire("3d", default=(10.0, 3.12, 2 * pi))
    goal_deviation: tuple[float, ...] = wire("3d", default=(10.0, 3.12, 2 * pi))
    asynchronous: bool = wire("?", since=10, default=False)
    max_velocity: tuple[float, ...] = wire("7d", since=10, default=(0.0,) * 7)


@dataclass(frozen=True, slots=True)
class StopMove:
    """Stops the motion at once."""


@dataclass(frozen=True, slots=True)
class GetCartesianLimit:
    """Requests a virtual wall by its number; protocol 5."""

    number: int = wire("i")


@dataclass(frozen=True, slots=True)
class SetCollisionBehavior:
    """Thresholds of contact (lower) and of the reflex (upper), while accelerating and at constant speed.

    Torques N m (7,), forces N and N m (6,).
    """

    lower_torque_acceleration: tuple[float, ...] = wire("7d")
    upper_torque_acceleration: tuple[float, ...] = wire("7d")
    lower_torque: tuple[float, ...] = wire("7d")
    upper_torque: tuple[float, ...] = wire("7d")
    lower_force_acceleration: tuple[float, ...] = wire("6d")
    upper_force_acceleration: tuple[float, ...] = wire("6d")
    lower_force: tuple[float, ...] = wire("6d")
    upper_force: tuple[float, ...] = wire("6d")


@dataclass(frozen=True, slots=True)
class SetJointImpedance:
    """Stiffness of the robot's own joint controller, N m/rad."""

    stiffness: tuple[float, ...] = wire("7d")


@dataclass(frozen=True, slots=True)
class SetCartesianImpedance:
    """Stiffness of the robot's own Cartesian controller, N/m and N m/rad."""

    stiffness: tuple[float, ...] = wire("6d")


@dataclass(frozen=True, slots=True)
class SetGuidingMode:
    """Selects the axes that give way when a person guides the arm by its buttons."""

    axes: tuple[bool, ...] = wire("6?")
    nullspace: bool = wire("?")


@dataclass(frozen=True, slots=True)
class SetEEToK:
    """The stiffness frame K in the end effector's frame, 4x4 column by column."""

    transform: tuple[float, ...] = wire("16d")


@dataclass(frozen=True, slots=True)
class SetNEToEE:
    """The end effector's frame in the nominal one, 4x4 column by column."""

    transform: tuple[float, ...] = wire("16d")


@dataclass(frozen=True, slots=True)
class SetLoad:
    """A carried load: kg, its centre in the flange's frame (m), its inertia about it (kg m^2, column by column)."""

    mass: float = wire("d")
    centre: tuple[float, ...] = wire("3d")
    inertia: tuple[float, ...] = wire("9d")


@dataclass(frozen=True, slots=True)
class SetFilters:
    """Cut-off frequencies of the robot's filters, Hz; protocol 5."""

    frequencies: tuple[float, ...] = wire("5d")


@dataclass(frozen=True, slots=True)
class AutomaticErrorRecovery:
    """Clears the errors, if the robot can do so by itself."""


@dataclass(frozen=True, slots=True)
class LoadModelLibrary:
    """Requests the model as a shared object.

    Architecture 0 x64, 1 x86, 2 ARM, 3 ARM64; system 0 Linux, 1 Windows.
    """

    architecture: int = wire("B")
    system: int = wire("B")


@dataclass(frozen=True, slots=True)
class GetRobotModel:
    """Requests the URDF; protocol 10."""


Body = (
    Connect | Move | StopMove | GetCartesianLimit | SetCollisionBehavior | SetJointImpedance | SetCartesianImpedance
    | SetGuidingMode | SetEEToK | SetNEToEE | SetLoad | SetFilters | AutomaticErrorRecovery | LoadModelLibrary
    | GetRobotModel
)  # fmt: skip
