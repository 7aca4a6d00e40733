"""Postures in which a tool is where it should be: damped least squares from many starts at once.

Source: Nakamura and Hanafusa, Inverse kinematic solutions with singularity robustness for robot manipulator control,
ASME J. Dyn. Syst. Meas. Control 108, 1986. A start that hasn't come there after `ITERATIONS` is drawn anew.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

STARTS: Final = 8
ITERATIONS: Final = 40
NEAR: Final = 5e-4  # m: the tool is there
_DAMPING: Final = 1e-3  # m^2, joints scaled by their ranges
_STEP: Final = 0.15  # of a joint's range, the most in a step
Residual = Callable[[Array], tuple[Array, Array]]


class Inverse:
    """One search; see the module's text.

    Attributes:
        iterations: how often all starts have moved.
    """

    def __init__(self, residual: Residual, lower: Array, upper: Array, here: Array, seed: int) -> None:
        """
        Args:
            residual: of postures (m, n): what is missing, (m, r) m, and its Jacobian of the tool, (m, r, n).
            lower, upper: (n,) rad or m.
            here: (n,), the first start.
            seed: of the other starts.
        """
        self._residual, self._lower, self._range = residual, lower, upper - lower
        self._rng = np.random.default_rng(seed)
        self._x = self._rng.uniform(size=(STARTS, len(lower)))
        self._x[0] = np.clip((here - lower) / self._range, 0.0, 1.0)
        self._ages = np.zeros(STARTS, np.intp)
        self.iterations = 0

    def step(self) -> Array:
        """All starts go one step. Returns the postures (k, n), rad or m, of those that were there before it."""
        self.iterations += 1
        missing, J = self._residual(self._lower + self._x * self._range)
        there = np.linalg.norm(missing, axis=1) < NEAR
        found: Array = self._lower + self._x[there] * self._range
        A = J * self._range
        change = _solved(A, missing)
        # A joint at its end that would go on is left out, once.
        stuck = ((self._x <= 0.0) & (change < 0.0)) | ((self._x >= 1.0) & (change > 0.0))
        if stuck.any():
            change = _solved(A * ~stuck[:, None], missing)
        change *= np.minimum(1.0, _STEP / np.maximum(np.abs(change).max(axis=1), 1e-12))[:, None]
        self._x = np.clip(self._x + change, 0.0, 1.0)
        self._ages += 1
        old = there | (self._ages > ITERATIONS)
        self._x[old] = self._rng.uniform(size=(int(old.sum()), self._x.shape[1]))
        self._ages[old] = 0
        return found


def _solved(A: Array, missing: Array) -> Array:
    """(m, n): damped least squares of A (m, r, n) x = missing (m, r)."""
    At = A.transpose(0, 2, 1)
    found: Array = (At @ np.linalg.solve(A @ At + _DAMPING * np.eye(A.shape[1]), missing[..., None]))[..., 0]
    return found
