"""Linear equations with a symmetric positive definite 6 x 6 matrix.

By Eigen's L D L^T, which comes with pinocchio: at this size a call of numpy's own solver costs ten times as much.
"""

from __future__ import annotations

from math import isfinite, nan, prod
from typing import Final

import eigenpy
import numpy as np

from runtime.contracts.signals import Array

NEAR: Final = 1e-6
"""Independence below which `damped` begins to damp; a Panda in 4000 random postures has 7e-6 at least."""
DAMPING: Final = 1e-6
"""What it adds at most to each diagonal element, as a share of it."""


class Equations:
    """Solves A x = b; of A (6, 6) only the lower triangle is read. One for each that uses it: it has a memory.

    A must be finite: Eigen takes what isn't for zero.
    """

    def __init__(self) -> None:
        self._factors = eigenpy.LDLT(6)

    def solve(self, A: Array, b: Array) -> Array:
        """x (6,); a row of zeros gives zero there."""
        self._factors.compute(A)
        x: Array = self._factors.solve(b)
        return x

    def damped(self, A: Array, b: Array) -> tuple[Array, float]:
        """As `solve`; near a singular A each diagonal element grows by a share of it, gradually (see NEAR, DAMPING).

        Also gives the rows' independence: det A over the product of its diagonal. It is 1 where they don't interfere
        and 0 where A is singular, and doesn't depend on their units nor on their order.
        """
        independence = self.determinant(A) / (prod(A.diagonal().tolist()) or 1.0)
        if independence >= NEAR:
            return self._factors.solve(b), independence
        if not isfinite(independence):
            return np.full(6, nan), independence
        away = 1.0 - independence / NEAR
        grown = A.copy()
        grown[range(6), range(6)] *= 1.0 + DAMPING * away * away
        return self.solve(grown, b), independence

    def determinant(self, A: Array) -> float:
        """det A; zero where A is singular within rounding."""
        factors = self._factors
        factors.compute(A)
        return max(prod(factors.vectorD().tolist()), 0.0)
