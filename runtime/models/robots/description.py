"""The description of a serial arm: placements of its joints, inertias of its links, limits of its drives.

Frames: the arm's base frame; one frame for each link, fixed to the link at the joint before it, with z along the
joint's axis; the flange frame, fixed to the last link, with z outward.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import cos, sin

import numpy as np
from numpy.typing import ArrayLike

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array


@dataclass(frozen=True, eq=False)
class Inertial:
    """A rigid body's mass (kg), centre of mass (3,) m and inertia (3, 3) kg m^2 about it, in its link's frame."""

    mass: float
    com: Array
    inertia: Array

    def moved(self, placement: Array) -> Inertial:
        """The same body in another frame; `placement` (4, 4) is this frame in the other one."""
        turn = placement[:3, :3]
        return Inertial(self.mass, placement[:3, 3] + turn @ self.com, turn @ self.inertia @ turn.T)


@dataclass(frozen=True)
class Payload:
    """A load as it is given to a robot: mass (kg) and centre of mass in the flange frame (m)."""

    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Capsule:
    """A contact shape of a link: a segment in the link's frame, m, and its radius."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and the link behind it. It turns about its z, or slides along it.

    Attributes:
        placement: (4, 4), the joint's frame at 0 in the frame of the link before it (the base for the first).
        link: the link's inertial parameters in its own frame.
        shape: the link's contact shapes.
    """

    name: str
    placement: Array
    link: Inertial
    shape: tuple[Capsule, ...] = ()
    slides: bool = False

    def moved(self, q: float) -> Array:
        """(4, 4): the link's frame in that of the link before, at q, rad or m."""
        return self.placement @ (trans(0.0, 0.0, q) if self.slides else rot_z(q))


@dataclass(frozen=True, eq=False)
class SlidingFriction:
    """Friction torque that grows smoothly with the joint's speed up to a bound, as identified by Gaz et al. 2019.

    tau = span (s(dq) - s(0)) with s(dq) = 1 / (1 + exp(-steepness (dq + offset))); zero at rest, without stiction.

    Attributes:
        span: phi_1 (n,) N m, from the bound in one direction to that in the other.
        steepness: phi_2 (n,) s/rad.
        offset: phi_3 (n,) rad/s: the bounds of the two directions differ.
    """

    span: Array
    steepness: Array
    offset: Array
    _rest: tuple[Array, Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for value in (self.span, self.steepness, self.offset):
            value.flags.writeable = False
        # Constants of `damping`, which a simulated arm asks in every step.
        rest = 0.5 * self.steepness * self.offset
        object.__setattr__(
            self, "_rest", (0.5 * self.steepness, rest, np.cosh(rest), 0.25 * self.span * self.steepness)
        )

    def torque(self, dq: Array) -> Array:
        """The torque against the motion, N m (n,), at dq (n,) rad/s."""
        found: Array = self.damping(dq) * dq
        return found

    def damping(self, dq: Array) -> Array:
        """The torque over the speed, N m s/rad (n,), at dq (n,) rad/s. It is positive and finite, at rest as well."""
        # s(dq) - s(0) = sinh(y/2) / (2 cosh(x/2) cosh(x0/2)) with y = x - x0: no difference of near values.
        steepness, rest, at_rest, most = self._rest
        half = steepness * dq
        np.minimum(np.maximum(half, -300.0, out=half), 300.0, out=half)
        half[np.abs(half) < 1e-6] = 1e-6
        bound = np.cosh(half + rest)
        bound *= half
        bound *= at_rest
        found: Array = np.sinh(half, out=half)
        found /= bound
        found *= most
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotDescription:
    """A serial arm with n joints. Arrays (n,) are read-only. Unpublished limits are inf.

    The units are those of joints that turn; of one that slides they are m, N, kg and so on.

    Attributes:
        base: the part that doesn't move, in the base frame.
        flange: (4, 4) in the last link's frame.
        q_lower, q_upper: rad.
        dq_max, ddq_max, dddq_max: rad/s, rad/s^2, rad/s^3.
        tau_max, dtau_max: N m, N m/s.
        rotor_inertia: kg m^2 at the joint, reflected through the gear.
        dry_friction: N m, which the robot's own controller compensates wholly or in part.
        sliding_friction: identified from the joints' torque sensors: what torque control doesn't compensate, or None.
        stiffness: stiffness of the position controller, N m/rad.
        inertia: kg m^2, the inertia that each joint usually moves; the position controller's damping is made for it.
        home: rad, a configuration far from limits and singularities.
        payload: kg, the greatest load.
        warnings: what is probably wrong with the file that it was read from.
        unseen: links of that file without contact shapes, since these are meshes there.
    """

    name: str
    base: Inertial
    base_shape: tuple[Capsule, ...]
    joints: tuple[Joint, ...]
    flange: Array
    q_lower: Array
    q_upper: Array
    dq_max: Array
    ddq_max: Array
    dddq_max: Array
    tau_max: Array
    dtau_max: Array
    rotor_inertia: Array
    dry_friction: Array
    sliding_friction: SlidingFriction | None = None
    stiffness: Array
    inertia: Array
    home: Array
    payload: float
    warnings: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The joints' names."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def slides(self) -> tuple[str, ...]:
        """The joints that slide."""
        return tuple(joint.name for joint in self.joints if joint.slides)

    @cached_property
    def weightless(self) -> tuple[str, ...]:
        """The joints behind which nothing has a mass: no law of torques and no simulation can move them."""
        found: list[str] = []
        for joint in reversed(self.joints):
            if joint.link.mass > 0.0:
                break
            found.append(joint.name)
        return tuple(reversed(found))

    def with_masses(self) -> RobotDescription:
        """The arm itself, for what needs its dynamics. Raises OptionError: there are none."""
        if self.weightless:
            problem = f"nothing behind the joint '{self.weightless[0]}' of {self.name} has a mass"
            raise OptionError(problem, "Give the URDF's links their <inertial>")
        return self

    def forward(self, q: Array) -> Array:
        """The flange (4, 4) in the base frame, m, at q (n,), rad or m. Simple and slow: for checks."""
        place = np.eye(4)
        for joint, value in zip(self.joints, q.tolist(), strict=True):
            place = place @ joint.moved(value)
        return place @ self.flange


def array(*values: float) -> Array:
    """Float64 values (n,)."""
    return np.array(values, dtype=float)


def everywhere(value: float, n: int) -> Array:
    """The same value for n joints."""
    return np.full(n, value)


def inertial(mass: float, com: ArrayLike, moments: tuple[float, float, float, float, float, float]) -> Inertial:
    """Makes an Inertial from mass (kg), centre of mass (m) and moments xx, yy, zz, xy, xz, yz (kg m^2) about it."""
    xx, yy, zz, xy, xz, yz = moments
    return Inertial(mass, np.array(com, dtype=float), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def rot_x(angle: float) -> Array:
    """The rotation (4, 4) about x by an angle, rad."""
    c, s = _cos_sin(angle)
    return np.array([[1.0, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def rot_z(angle: float) -> Array:
    """The rotation (4, 4) about z by an angle, rad."""
    c, s = _cos_sin(angle)
    return np.array([[c, -s, 0.0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def trans(x: float, y: float, z: float) -> Array:
    """The translation (4, 4), m."""
    place = np.eye(4)
    place[:3, 3] = x, y, z
    return place


def _cos_sin(angle: float) -> tuple[float, float]:
    c, s = cos(angle), sin(angle)
    # Right angles of a kinematic table must be exact.
    return (0.0 if abs(c) < 1e-16 else c), (0.0 if abs(s) < 1e-16 else s)
