"""How a UR controller moves its joints' targets: URScript's motions, one control cycle at a time.

speedj and stopj apply the acceleration to the joint whose velocity changes most; the others change in proportion.
servoj follows a target through a first-order lag. Source: protocol sheet ur-rtde, section 5.1; the controller's
internals aren't public.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite, sqrt
from typing import Final, Literal

import numpy as np

from drivers.ur.registers import CYCLE
from runtime.contracts.signals import Array

_SERVO_ACCELERATION: Final = 40.0  # rad/s^2
_SERVO_GAIN: Final = 300.0  # gain at which servoj lags by its lookahead
_AT_REST: Final = 1e-9  # rad/s

Doing = Literal["hold", "speed", "servo", "stop", "move"]


class Motion:
    """Targets of six joints.

    Motions raise ValueError for values that URScript refuses: values that aren't finite or positive, lookahead and gain
    out of their range.

    Attributes:
        q, qd, qdd: (6,) targets, rad, rad/s, rad/s^2.
        doing: the present motion.
    """

    def __init__(self, q: Array) -> None:
        self.q, self.qd, self.qdd = q.copy(), np.zeros(6), np.zeros(6)
        self.doing: Doing = "hold"
        self._goal = np.zeros(6)
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

    def halt(self, q: Array) -> None:
        """Ends all motion: brakes hold the joints where they are."""
        self.doing = "hold"
        self.q[:], self.qd[:], self.qdd[:] = q, 0.0, 0.0

    @property
    def at_rest(self) -> bool:
        """Whether a motion that has an end has reached it."""
        return self.doing == "hold"

    def cycle(self, scaling: float) -> None:
        """Runs one control cycle; `scaling` slows all motions except the stop."""
        was = self.qd.copy()
        if self.doing == "speed":
            self._towards(self._goal * scaling, self._a)
        elif self.doing == "stop":
            self._towards(np.zeros(6), self._a)
        elif self.doing == "servo":
            self._servo(scaling)
        elif self.doing == "move":
            self._move(scaling)
        else:
            self.qd[:] = 0.0
        self.q += (was + self.qd) * (CYCLE / 2)
        self.qdd[:] = (self.qd - was) / CYCLE
        if self.doing == "stop" and np.abs(self.qd).max() < _AT_REST:
            self.doing = "hold"

    def _aim(self, goal: Sequence[float]) -> None:
        if len(goal) != 6 or not all(map(isfinite, goal)):
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
            self.q[:] = self._goal
            self.qd[:] = 0.0
            self.doing = "hold"
            return
        step = self._a * CYCLE
        speed = min(self._v * scaling, sqrt(2 * self._a * longest + step * step) - step, longest / CYCLE)
        self._towards(left * (speed / longest), 2 * self._a if speed < fastest else self._a)


def _positive(value: float) -> float:
    if not 0 < value < inf:
        raise ValueError("speeds and accelerations must be positive")
    return value
