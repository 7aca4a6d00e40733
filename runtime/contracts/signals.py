"""The signals between devices and controllers: named arrays of fixed shape in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One named array of float64.

    Attributes:
        name: the field's standard term, as a slug: "position", "wrench", "tips".
        shape: e.g. (22,) or (5, 3).
        unit: SI: "rad", "m", "N", "N m", "rad/s"; "1" for a pure number or a button (0 or 1).
        frame: the frame of its coordinates, in the profile's tree; None for joint space.
        labels: a name for each row (joints, fingertips); empty where there are no names.
        visual: how a viewer shows it: "points" for shape (k, 3); "robot" for the same, drawn as thick as an arm;
            "sphere" for (x, y, z, radius); "path" for a position (3,) or pose (7,) that leaves a trail; "arrow" for
            (2, 3), its start point (m) and a force (N) at that point.
        links: polylines through the points' rows, for visuals "points" and "robot".
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    frame: str | None = None
    labels: tuple[str, ...] = ()
    visual: Literal["", "points", "robot", "sphere", "path", "arrow"] = ""
    links: tuple[tuple[int, ...], ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 elements."""
        return int(np.prod(self.shape, dtype=int))


class Kind(StrEnum):
    """The physical quantity of a command. It decides how the guard limits the command."""

    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE = "torque"


class Stop(StrEnum):
    """Stop categories of an actuator."""

    HOLD = "hold"  # stay at the last command, braking within limits
    DAMP = "damp"  # oppose motion, yield to force
    LIMP = "limp"  # no torque (with gravity compensation where the device offers it)
    RETRACT = "retract"  # go to the rest configuration slowly
    BRAKE = "brake"  # ramp the velocity to zero, then the device's own brake


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a command, each of the command's own shape. None means that the source gives no limit.

    Units follow the command. `lower` and `upper` bound the position (rad or m), for kinds position, velocity
    and torque alike. `velocity`, `acceleration` and `jerk` bound its derivatives. `effort` bounds the torque
    (N m), `effort_rate` its rate (N m/s). `inertia` (kg m^2 or kg) is the least inertia that the joint moves;
    it bounds the damping of a torque command.
    """

    lower: Array | None = None
    upper: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    jerk: Array | None = None
    effort: Array | None = None
    effort_rate: Array | None = None
    inertia: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Command(Signal):
    """A signal that a device obeys.

    Attributes:
        kind: position, velocity or torque.
        feedback: the device's state signal that measures the same coordinates; None for a device
            without feedback (a hobby servo). A command without feedback starts at the profile's `home`.
        stops: the stop categories this interface supports, the default first.
        period: s; in normal operation a command leaves for the device at least this often while it is active. The
            runtime takes a longer pause for a stalled link. Required for every command that is wired.
        resolution: the largest difference between a command and what leaves for the device that is normal
            (rounding, a filter in the driver), in the command's unit; one number, or one for each element.
    """

    kind: Kind
    feedback: str | None = None
    stops: tuple[Stop, ...] = (Stop.HOLD,)
    period: float | None = None
    resolution: float | tuple[float, ...] = 0.0
