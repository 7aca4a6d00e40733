"""The least change of an arm's joints that brings its tip where a rigid base would have it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.control.strap.axes import Axes, Axis
from srl.runtime.contracts.rotation import Quaternion, Vector, conjugate, turned
from srl.runtime.contracts.signals import Array

SLIDE: Final = 0.1  # m of a prismatic axis that count as much as 1 rad of a revolute one
STEPS: Final = 4  # at most, of Gauss-Newton's method, in one call
MOST_FREED: Final = 7  # times that a held joint is freed in one solution
FLAT: Final = 1e-6  # slope, 1/rad: a joint that gains less stays where it is
CLOSE: Final = 1e-5  # m; nearer than this is there


class Correction:
    """Solves min |p(q + d) - p'|^2 / damping^2 + |d / w|^2 over d with q + d within the limits.

    p' is where the tip must be in the axes of a base that is turned: R^T p(q). Damping bounds d near a singularity.
    Away from it about damping^2 / (damping^2 + s^2) of the error is left, where s (m/rad) is how well the arm moves
    there. Joints that reach a limit stay there, and the others do their part; one that the others would rather have
    moved back is freed again.
    """

    def __init__(self, axes: Sequence[Axis], damping: float, first: Vector = (0.0, 0.0, 0.0)) -> None:
        """Args:
        axes: from the base to the tip.
        damping: m/rad.
        first: m, from the base to the first axis.
        """
        self._arm = Axes(tuple(axes), first)
        self._weight = np.array([SLIDE * SLIDE if axis.slides else 1.0 for axis in axes])
        self._lower = np.array([axis.lower for axis in axes])
        self._upper = np.array([axis.upper for axis in axes])
        self._damping = damping * damping * np.eye(3)
        self.d = np.zeros(len(axes))
        self.error = 0.0
        """m, between the tip and where it must be, at the last solution."""

    def reset(self) -> None:
        """Begins anew at no correction."""
        self.d[:] = 0.0
        self.error = 0.0

    def tip(self, q: Array) -> Array:
        """(3,), m, in the base's axes, at joints q (n,)."""
        return np.array(self._arm.forward(q.tolist())[0])

    def solve(self, q: Array, base: Quaternion) -> Array:
        """Returns d (n,), rad or m; a view that the next call changes.

        Args:
            q: (n,), the joints that a rigid base would want.
            base: the base's rotation from where a rigid one would be.
        """
        wanted = np.array(turned(conjugate(base), self._arm.forward(q.tolist())[0]))
        low, high = np.minimum(self._lower - q, 0.0), np.maximum(self._upper - q, 0.0)
        d = np.clip(self.d, low, high)
        for _ in range(STEPS):
            tip, columns = self._arm.forward((q + d).tolist())
            J = np.array(columns).T
            new = self._bounded(J, wanted - tip + J.dot(d), low, high)
            step = float(np.abs(J.dot(new - d)).max())
            d = new
            if step < CLOSE:
                break
        self.d[:] = d
        self.error = float(np.linalg.norm(self.tip(q + d) - wanted))
        return self.d

    def _bounded(self, J: Array, task: Array, low: Array, high: Array) -> Array:
        """The solution of the linear problem J d = task: joints beyond a limit are held at it, and freed one by one.

        Holding several at once may hold one too many. At the solution no cost falls where a held joint moves inwards.
        """
        d = np.zeros(J.shape[1])
        free = np.ones(J.shape[1], bool)
        freed = 0
        while True:
            WJ = np.where(free, self._weight, 0.0)[:, None] * J.T
            d[free] = WJ.dot(np.linalg.solve(J.dot(WJ) + self._damping, task - J[:, ~free].dot(d[~free])))[free]
            beyond = free & ((d < low) | (d > high))
            if not beyond.any():
                if free.all() or freed == MOST_FREED:
                    return d
                # The cost's slope; what is held at both limits stays.
                slope = J.T.dot(J.dot(d) - task) / self._damping[0, 0] + d / self._weight
                inwards = np.where(free | (low == high), 0.0, np.where(d <= low, -slope, slope))
                worst = int(inwards.argmax())
                if inwards[worst] <= FLAT:
                    return d
                free[worst] = True
                freed += 1
                continue
            d[beyond] = np.clip(d[beyond], low[beyond], high[beyond])
            free &= ~beyond
