"""Whether an arm can follow a path: it is tried along the path, a little in each cycle."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.operation.demonstration import PERIOD, TaskError, TaskPath
from srl.control.operation.worn import Worn
from srl.control.skeleton.ranges import JointRanges
from srl.runtime.contracts.signals import Array

NEAR: Final = 0.005  # m: a point is reached within it
_TRIES: Final = 200  # steps at one point; most need one to three
MOST: Final = _TRIES + 1  # steps that a point takes at most
_DAMPING: Final = 1e-3  # m^2, of the least squares, joints scaled by their ranges
_STEP: Final = 0.1  # of a joint's range, the most in a step
_HOME: Final = 0.02  # of what is missing to the given posture in a step, where the point leaves freedom


class Reach:
    """Follows a path's points one by one by damped least squares, from where the arm is.

    Attributes:
        done: every point was reached.
    """

    def __init__(self, path: TaskPath, arm: Worn, ranges: JointRanges, start: Array) -> None:
        """`arm` is used at each step, so its posture changes; `start` (n,) rad or m."""
        self._path, self._arm = path, arm
        self._lower, self._range = ranges.q_lower, ranges.q_upper - ranges.q_lower
        self._x = np.clip((start - self._lower) / self._range, 0.0, 1.0)  # shares of the ranges
        self._posture = (ranges.posture - self._lower) / self._range
        self._at = self._tries = 0

    @property
    def done(self) -> bool:
        return self._at == len(self._path.points)

    def step(self, count: int = 1) -> bool:
        """Takes up to so many steps; returns `done`. Raises TaskError: a point is out of reach."""
        for _ in range(count):
            if self.done:
                break
            self._one()
        return self.done

    def _one(self) -> None:
        tip, J = self._arm.tip(self._lower + self._x * self._range)
        away = self._path.points[self._at] - tip
        missing = float(np.linalg.norm(away))
        if missing < NEAR:
            self._at, self._tries = self._at + 1, 0
            return
        self._tries += 1
        if self._tries > _TRIES:
            problem = (
                f"the arm doesn't reach the place {self._at * PERIOD:.1f} s after the beginning: "
                f"{1e3 * missing:.0f} mm are missing"
            )
            raise TaskError("demonstration", problem, "Show the task nearer to the arm, or shift it (`shift`)")
        A = J * self._range
        # A joint at its end that would go on is left out.
        for _ in range(2):
            G = A.T @ np.linalg.inv(A @ A.T + _DAMPING * np.eye(3))
            change = G @ away
            home = _HOME * (self._posture - self._x)
            change += home - G @ (A @ home)
            stuck = ((self._x <= 0.0) & (change < 0.0)) | ((self._x >= 1.0) & (change > 0.0))
            if not stuck.any():
                break
            A = A * ~stuck
            change[stuck] = 0.0
        change *= min(1.0, _STEP / max(float(np.abs(change).max()), 1e-12))
        self._x = np.clip(self._x + change, 0.0, 1.0)
