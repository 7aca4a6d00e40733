"""URScript's force mode: in chosen directions the arm yields until it presses with the given force.

In these directions the TCP has a mass of its own and follows force, not motion; in the others it goes on with the
program's motion. Source of the meaning of frame, selection, limits, damping and gain: the URScript manual (force_mode).
The controller's law isn't public: the mass here is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from srl.drivers.ur.registers import CYCLE
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ur.kinematics import Kinematics, bounded, placement

_MASS: Final = np.repeat((10.0, 0.5), 3)  # kg, kg m^2
_PLAIN: Final = 2  # the frame is taken as it is


class ForceMode:
    """Force mode on top of whatever moves the arm.

    Attributes:
        on: whether force mode is active.
        q, qd: (6,) rad, rad/s, what it adds to the motion's targets.
        damping: share of the speed that is lost in each control cycle, 0 to 1.
        gain: multiplies the force error, 0 to 2.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self.on = False
        self.q, self.qd = np.zeros(6), np.zeros(6)
        self.damping, self.gain = 0.005, 1.0
        self._frame = placement(np.zeros(6))
        self._yields = np.zeros(6, bool)
        self._wanted, self._limits, self._speed = np.zeros(6), np.ones(6), np.zeros(6)

    def set(
        self, frame: Any, selection: Sequence[float], wrench: Sequence[float], kind: int, limits: Sequence[float]
    ) -> None:
        """force_mode. Raises ValueError.

        Args:
            frame: the directions' frame in `base`, a pose.
            selection: (6,), 1 in each direction that yields.
            wrench: (6,) N, N m, with which the TCP is to press on its surroundings, in the frame.
            kind: 2; the frames that follow the TCP (1, 3) are refused.
            limits: (6,) in yielding directions the greatest speed, m/s and rad/s; else the greatest deviation, m, rad.
        """
        if kind != _PLAIN:
            raise ValueError(f"force mode of type {kind}: this twin has type {_PLAIN} only")
        values = [*wrench, *limits]
        if len(selection) != 6 or len(values) != 12 or not bounded(values) or min(limits) <= 0:
            raise ValueError("force mode needs six selections, six finite forces, six limits above 0")
        self._frame = placement(frame)
        self._yields[:] = [bool(chosen) for chosen in selection]
        self._wanted[:], self._limits[:] = wrench, limits
        if not self.on:
            self.on = True
            self._speed[:] = 0.0

    def end(self) -> None:
        """end_force_mode; whoever calls it must take over `q` and `qd` first."""
        self.on = False
        self.q[:], self.qd[:] = 0.0, 0.0

    def cycle(self, q: Array, qd: Array, felt: Array) -> None:
        """Runs one control cycle.

        Args:
            q, qd: (6,) the motion's targets.
            felt: (6,) N, N m, the wrench on the TCP from outside, axes of `base`.
        """
        if not self.on:
            return
        turn = self._frame.rotation.T
        felt = np.concatenate([turn @ felt[:3], turn @ felt[3:]])
        push = np.where(self._yields, self._wanted + felt, 0.0)
        self._speed *= 1 - self.damping
        self._speed += self.gain * CYCLE / _MASS * push
        np.clip(self._speed, -self._limits, self._limits, out=self._speed)
        self._speed[~self._yields] = 0.0
        J = self._kinematics.jacobian(q + self.q)
        carried = J @ qd
        carried = np.concatenate([turn @ carried[:3], turn @ carried[3:]])
        change = np.where(self._yields, self._speed - carried, 0.0)
        change = np.concatenate([turn.T @ change[:3], turn.T @ change[3:]])
        # Next to a singularity the arm yields more slowly than the force asks for.
        self.qd[:] = J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), change)
        self.q += self.qd * CYCLE

    def strays(self, asked: Array, actual: Array) -> bool:
        """Whether the TCP left a direction that doesn't yield further than its limit (angles asked for and real)."""
        if not self.on:
            return False
        forward, turn = self._kinematics.forward, self._frame.rotation.T
        off = self._kinematics.error(forward(asked), forward(actual))
        off = np.concatenate([turn @ off[:3], turn @ off[3:]])
        return bool((np.abs(off) > self._limits)[~self._yields].any())
