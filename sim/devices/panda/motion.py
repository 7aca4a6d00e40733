"""A Franka robot's checks of the setpoints it gets: limits, discontinuities, lost packets of the client.

Source: protocol sheet franka-fci, sections 6 and 7. Every check is written so that a NaN fails it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.drivers.panda.limits import DT, FR3, PANDA, TORQUE_RATE
from srl.drivers.panda.packets import Generator
from srl.runtime.contracts.signals import Array

LOST_IN_A_ROW: Final = 20  # packets
WINDOW: Final = 100  # packets over which the success rate is computed
TORQUE_STEP: Final = TORQUE_RATE * DT  # N m from one packet to the next
_TORQUE_STEP: Final = TORQUE_STEP + 1e-9  # with rounding
# Differences of setpoints are divided by DT up to three times, so rounding errors must not look like jerk. A client
# that starts from the float32 state of protocol 10 is off by up to 1.2e-7 rad.
_ROUNDING: Final = 1.001
_BROKEN: Final = (
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
)


_ZEROS: Final = (0.0,) * 7


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits that the robot enforces; arrays (7,). rad, rad/s, rad/s^2, rad/s^3, N m.

    `velocity_offset` (rad/s) and `deceleration` (rad/s^2) reduce the velocity limit of an FR3 towards the ends of a
    joint's range; None on a Panda.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    effort: Array
    velocity_offset: Array | None = None
    deceleration: Array | None = None

    def velocities(self, q: Array) -> tuple[Array, Array]:
        """The smallest and the largest velocity (7,) allowed at q."""
        if self.velocity_offset is None or self.deceleration is None:
            return -self.velocity, self.velocity
        offset, twice = self.velocity_offset, 2 * self.deceleration
        up = np.sqrt(np.maximum(twice * (self.upper - q), 0.0)) - offset
        down = np.sqrt(np.maximum(twice * (q - self.lower), 0.0)) - offset
        return -np.clip(down, 0.0, self.velocity), np.clip(up, 0.0, self.velocity)


@dataclass(slots=True)
class Setpoint:
    """The content of one RobotCommand.

    Attributes:
        q, dq: the motion generator's values, rad and rad/s (7,).
        tau: the external controller's torques, N m (7,), gravity excluded.
        finished: whether the motion ends with this packet.
    """

    q: Sequence[float] | Array = _ZEROS
    dq: Sequence[float] | Array = _ZEROS
    tau: Sequence[float] | Array = _ZEROS
    finished: bool = False


class JointGenerator:
    """The desired joint motion, from setpoints; if one is lost, extrapolated at constant acceleration.

    Attributes:
        q, dq, ddq: present desired values (7,): rad, rad/s, rad/s^2.
        state: (3, 7), these.
    """

    def __init__(self, limits: JointLimits, q: Array) -> None:
        self.limits = limits
        self.state = np.zeros((3, 7))
        self.q, self.dq, self.ddq = self.state
        self.q[:] = q
        self._started = False
        self._rests = False  # it stands where a setpoint has put it: another one that moves nothing changes nothing
        # What a setpoint may ask for: positions, velocities, accelerations, jerks.
        self._new = np.zeros((4, 7))
        slowest, fastest = limits.velocities(q)
        bounds = [(limits.lower, limits.upper), (slowest * _ROUNDING, fastest * _ROUNDING)]
        bounds += [(-most * _ROUNDING, most * _ROUNDING) for most in (limits.acceleration, limits.jerk)]
        self._least, self._most = np.array(bounds).swapaxes(0, 1).copy()

    def begin(self) -> None:
        """Starts a motion from rest; its first setpoint must fit the present desired position."""
        self.dq[:] = self.ddq[:] = 0.0
        self._started, self._rests = True, False

    def place(self, q: Array, dq: Array) -> None:
        """Sets the desired values to the measured ones, after a motion that the generator didn't make."""
        self.q[:], self.dq[:], self.ddq[:], self._rests = q, dq, 0.0, False

    def extrapolate(self) -> None:
        """Replaces a lost setpoint."""
        self.dq += self.ddq * DT
        self.q += self.dq * DT

    def brake(self) -> None:
        """Reduces the desired velocity to zero, at half the greatest acceleration."""
        if not self.dq.any():
            self.ddq[:] = 0.0
            return
        step = self.limits.acceleration * (0.5 * DT)
        dq = self.dq - np.clip(self.dq, -step, step)
        self.ddq[:] = (dq - self.dq) / DT
        self.dq[:] = dq
        self.q += dq * DT

    def take(self, setpoint: Setpoint, generator: Generator) -> str:
        """Takes the next setpoint; returns the name of its error, or "". A faulty setpoint isn't used."""
        first, self._started = self._started, False
        if self._rests and generator is Generator.JOINT_VELOCITY and not any(setpoint.dq):
            return ""
        bounds, new = self.limits, self._new
        q, dq, ddq, dddq = new
        if generator is Generator.JOINT_POSITION:
            q[:] = setpoint.q
            np.divide(np.subtract(q, self.q, out=dq), DT, out=dq)
            if first and not (np.abs(dq) <= bounds.velocity).all():
                return "joint_position_motion_generator_start_pose_invalid"
        else:
            dq[:] = setpoint.dq
            np.add(self.q, np.multiply(dq, DT, out=q), out=q)
        np.divide(np.subtract(dq, self.dq, out=ddq), DT, out=ddq)
        np.divide(np.subtract(ddq, self.ddq, out=dddq), DT, out=dddq)
        if bounds.velocity_offset is not None:
            slowest, fastest = bounds.velocities(q)
            self._least[1], self._most[1] = slowest * _ROUNDING, fastest * _ROUNDING
        within = ((new >= self._least) & (new <= self._most)).all(axis=1).tolist()
        if not all(within):
            return _BROKEN[within.index(False)]
        self.state[:] = new[:3]
        self._rests = not (self.dq.any() or self.ddq.any())
        return ""


def torque_error(last: Array, new: Sequence[float] | Array) -> str:
    """The error of a torque setpoint that follows the last one, or ""."""
    for torque, before in zip(new, last.tolist(), strict=True):
        if not -_TORQUE_STEP <= torque - before <= _TORQUE_STEP:
            return "controller_torque_discontinuity"
    return ""


class Reception:
    """Counts which packets of a motion arrived in time.

    Attributes:
        rate: share of the last 100 packets that did.
        lost: present number of packets lost in a row.
        total: packets lost since the start, over all motions.
    """

    def __init__(self) -> None:
        self.total = 0
        self._arrived: NDArray[np.bool_] = np.zeros(WINDOW, np.bool_)
        self.begin()

    def begin(self) -> None:
        """Starts the count for a new motion."""
        self._arrived[:] = False
        self._number = 0
        self._good = 0
        self.lost = 0

    @property
    def rate(self) -> float:
        return self._good / min(self._number, WINDOW) if self._number else 0.0

    def count(self, arrived: bool) -> None:
        """Counts one millisecond, with or without its packet."""
        place = self._number % WINDOW
        self._good += int(arrived) - int(self._arrived[place])
        self._arrived[place] = arrived
        self._number += 1
        self.lost = 0 if arrived else self.lost + 1
        self.total += not arrived


def limits_of(robot: str) -> JointLimits:
    """Returns the limits that a `panda` or an `fr3` enforces."""
    known = FR3 if robot == "fr3" else PANDA
    narrowing = [None if values is None else np.array(values) for values in (known.offset, known.deceleration)]
    enforced = (known.lower, known.upper, known.velocity, known.acceleration, known.jerk, known.effort)
    return JointLimits(*map(np.array, enforced), *narrowing)
