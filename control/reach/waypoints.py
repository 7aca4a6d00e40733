"""Points that the joints pass together, as fast as the slowest one can."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.reach.connect import Free, along
from srl.runtime.contracts.signals import Array

NEAR: Final = 1e-3  # of a second's way: the goal is reached
AHEAD: Final = 16  # points of the way that are looked at in a cycle
_BRAKES: Final = 0.6  # of the acceleration, towards a point


class Waypoints:
    """It is cut short where the arm sees a later point. All is scaled: joints over their greatest speeds, in s."""

    def __init__(self, points: list[Array], free: Free, acceleration: Array) -> None:
        """
        Args:
            points: (n,) each, that are still to be passed; the goal is the last.
            free: whether the arm may be at points (m, n).
            acceleration: (n,) 1/s, of the joints.
        """
        self._points, self._free, self._a = points, free, _BRAKES * acceleration

    def left(self, here: Array) -> float:
        """s of the way from `here`, (n,), through all points."""
        return float(np.abs(np.diff([here, *self._points], axis=0)).max(axis=1).sum())

    def free(self, here: Array) -> bool:
        """Whether the arm may go on from `here`, (n,)."""
        return bool(self._free(along(here, self._points[0])[:AHEAD]).all())

    def speed(self, here: Array) -> Array:
        """(n,): straight to the next point, braking before it."""
        left = self._next(here) - here
        far = np.abs(left)
        most = np.minimum(1.0, np.sqrt(2.0 * self._a * far) + 1e-9)
        slowest = float((far / most).max())
        return left / max(slowest, 1e-9)

    def _next(self, here: Array) -> Array:
        """The next point; the one after it where the arm is there, or sees it."""
        points = self._points
        while len(points) > 1:
            near = float(np.abs(points[0] - here).max()) < 10 * NEAR
            if not near and not self._free(along(here, points[1])[: 2 * AHEAD]).all():
                break
            points.pop(0)
        return points[0]
