"""How a UR controller moves its joints' targets: URScript's motions, one control cycle at a time.

speedj and stopj apply the acceleration to the joint whose velocity changes most; the others change in proportion.
speedl, movel and stopl do the same to the TCP's velocity, where m and rad count alike; they end before a singularity.
servoj follows a target through a first-order lag. Source: protocol sheet ur-rtde, section 5.1; the controller's
internals aren't public.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import Any, Final, Literal

import numpy as np

from srl.drivers.ur.registers import CYCLE
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ur.kinematics import Kinematics, bounded, placement

_SERVO_ACCELERATION: Final = 40.0  # rad/s^2
_SERVO_GAIN: Final = 300.0  # gain at which servoj lags by its lookahead
_AT_REST: Final = 1e-9  # rad/s

_ARRIVED: Final = 1e-6  # m or rad

Doing = Literal["hold", "speed", "servo", "stop", "move", "speed-tool", "stop-tool", "move-tool", "free"]


class Motion:
    """Targets of six joints.

    Motions raise ValueError for values that URScript refuses: values that aren't finite or positive, lookahead and gain
    out of their range.

    Attributes:
        q, qd, qdd: (6,) targets, rad, rad/s, rad/s^2.
        doing: the present motion.
        singular: whether a Cartesian motion came too near to a singularity, and was slowed down.
    """

    def __init__(self, q: Array, kinematics: Kinematics, fastest: Array) -> None:
        """`fastest`: (6,) rad/s, greatest velocities, which Cartesian motions keep."""
        self.q, self.qd, self.qdd = q.copy(), np.zeros(6), np.zeros(6)
        self.doing: Doing = "hold"
        self.singular = False
        self._kinematics, self._fastest = kinematics, fastest
        self._goal = np.zeros(6)
        self._place = placement(np.zeros(6))
        self._a = 1.0
        self._v = 1.0
        self._lag = 0.1

    def speed(self, qd: Sequence[float], acceleration: float) -> None:
        """speedj: accelerates to these velocities (rad/s) and keeps them."""
        self._aim(qd)
        self.doing, self._a = "speed", _positive(acceleration)

    def servo(self, q: Sequence[float], lookahead: float, gain: float) -> None:
        """servoj: follows a target (rad)."""
        if not (0.03 <= lookahead <= 0.2 and 100 <= gain <= 2000):
            raise ValueError("lookahead must be 0.03 to 0.2 s, gain 100 to 2000")
        self._aim(q)
        self.doing, self._lag = "servo", max(lookahead * _SERVO_GAIN / gain, 2 * CYCLE)

    def stop(self, deceleration: float) -> None:
        """stopj: decelerates to rest."""
        self.doing, self._a = "stop", _positive(deceleration)

    def move(self, q: Sequence[float], acceleration: float, speed: float) -> None:
        """movej: moves to these angles (rad) and rests there."""
        self._aim(q)
        self._a, self._v = _positive(acceleration), _positive(speed)
        self.doing = "move"

    def speed_tool(self, xd: Sequence[float], acceleration: float) -> None:
        """speedl: accelerates the TCP to this velocity (m/s, rad/s, axes of `base`) and keeps it."""
        self._aim(xd)
        self.doing, self._a = "speed-tool", _positive(acceleration)

    def stop_tool(self, deceleration: float) -> None:
        """stopl: decelerates the TCP to rest."""
        self.doing, self._a = "stop-tool", _positive(deceleration)

    def move_tool(self, pose: Sequence[float], acceleration: float, speed: float) -> None:
        """movel: moves the TCP in a straight line to this pose in `base` and rests there."""
        self._place = placement(pose)
        self._a, self._v = _positive(acceleration), _positive(speed)
        self.doing = "move-tool"

    def free(self) -> None:
        """freedrive: people move the joints; the targets follow them."""
        self.doing = "free"

    def left(self) -> float:
        """m between the TCP and the place where the present move ends; 0 if there is no move."""
        here = self._kinematics.forward(self.q).translation
        if self.doing == "move-tool":
            return float(np.linalg.norm(self._place.translation - here))
        if self.doing == "move":
            return float(np.linalg.norm(self._kinematics.forward(self._goal).translation - here))
        return 0.0

    def waypoint(self) -> Any:
        """Where the present move ends, or else where the arm is: the TCP in `base`, a `pinocchio.SE3`."""
        if self.doing == "move-tool":
            return self._place
        return self._kinematics.forward(self._goal if self.doing == "move" else self.q)

    def halt(self, q: Array) -> None:
        """Ends all motion: brakes hold the joints where they are."""
        self.doing = "hold"
        self.q[:], self.qd[:], self.qdd[:] = q, 0.0, 0.0

    @property
    def at_rest(self) -> bool:
        """Whether a motion that has an end has reached it."""
        return self.doing == "hold"

    @property
    def driven(self) -> bool:
        """Whether the present motion is one of a program's, which doesn't outlive it."""
        return self.doing not in ("hold", "stop", "stop-tool")

    def follow(self, q: Array, qd: Array) -> None:
        """Takes over angles and velocities (rad, rad/s) of joints that something else has moved."""
        self.q[:], self.qd[:] = q, qd

    def cycle(self, scaling: float) -> None:
        """Runs one control cycle; `scaling` slows all motions except the stop."""
        if self.doing == "free":
            return
        was = self.qd.copy()
        self.singular = False
        if self.doing == "speed":
            self._towards(self._goal * scaling, self._a)
        elif self.doing == "stop":
            self._towards(np.zeros(6), self._a)
        elif self.doing == "servo":
            self._servo(scaling)
        elif self.doing == "move":
            self._move(scaling)
        elif self.doing == "speed-tool":
            self._tool_towards(self._goal * scaling, self._a)
        elif self.doing == "stop-tool":
            self._tool_towards(np.zeros(6), self._a)
        elif self.doing == "move-tool":
            self._move_tool(scaling)
        else:
            self.qd[:] = 0.0
        self.q += (was + self.qd) * (CYCLE / 2)
        self.qdd[:] = (self.qd - was) / CYCLE
        if self.doing in ("stop", "stop-tool") and np.abs(self.qd).max() < _AT_REST:
            self.doing = "hold"

    def _aim(self, goal: Sequence[float]) -> None:
        if len(goal) != 6 or not bounded(goal):
            raise ValueError("six finite joint values are needed")
        self._goal[:] = goal

    def _towards(self, qd: Array, acceleration: float) -> None:
        change = qd - self.qd
        largest = float(np.abs(change).max())
        if largest > acceleration * CYCLE:
            change *= acceleration * CYCLE / largest
        self.qd += change

    def _servo(self, scaling: float) -> None:
        left = self._goal - self.q
        braking = np.sqrt(2 * _SERVO_ACCELERATION * np.abs(left))  # faster than this, the joint would overshoot
        wanted = np.clip(left / self._lag, -braking, braking) * scaling
        step = _SERVO_ACCELERATION * CYCLE
        self.qd += np.clip(wanted - self.qd, -step, step)

    def _move(self, scaling: float) -> None:
        left = self._goal - self.q
        longest = float(np.abs(left).max())
        fastest = float(np.abs(self.qd).max())
        if longest < 1e-7 or (longest < 1e-4 and fastest < self._a * CYCLE * 2):
            self.q[:] = self._goal - self.qd * (CYCLE / 2)  # the rest of this cycle leads there
            self.qd[:] = 0.0
            self.doing = "hold"
            return
        step = self._a * CYCLE
        speed = min(self._v * scaling, sqrt(2 * self._a * longest + step * step) - step, longest / CYCLE)
        self._towards(left * (speed / longest), 2 * self._a if speed < fastest else self._a)

    def _tool_towards(self, xd: Array, acceleration: float) -> None:
        J = self._kinematics.jacobian(self.q)
        now = J @ self.qd
        change = xd - now
        largest = max(float(np.linalg.norm(change[:3])), float(np.linalg.norm(change[3:])))
        if largest > acceleration * CYCLE:
            change *= acceleration * CYCLE / largest
        try:
            qd = np.linalg.solve(J, now + change)
        except np.linalg.LinAlgError:
            qd = np.full(6, inf)
        excess = float((np.abs(qd) / self._fastest).max())
        if excess > 1.0:
            self.singular = True
            qd = qd / excess if excess < inf else self.qd
        self.qd[:] = qd

    def _move_tool(self, scaling: float) -> None:
        left = self._kinematics.error(self._place, self._kinematics.forward(self.q))
        longest = max(float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:])))
        fastest = float(np.abs(self.qd).max())
        if longest < _ARRIVED and fastest < self._a * CYCLE * 2:
            self.qd[:] = 0.0
            self.doing = "hold"
            return
        step = self._a * CYCLE
        speed = min(self._v * scaling, sqrt(2 * self._a * longest + step * step) - step, longest / CYCLE)
        moving = self._kinematics.jacobian(self.q) @ self.qd
        slower = speed < max(float(np.linalg.norm(moving[:3])), float(np.linalg.norm(moving[3:])))
        self._tool_towards(left * (speed / max(longest, 1e-12)), 2 * self._a if slower else self._a)


def _positive(value: float) -> float:
    if not 0 < value < inf:
        raise ValueError("speeds and accelerations must be positive")
    return value
