"""Linear equations with a symmetric positive definite 6 x 6 matrix.

It uses Eigen's L D L^T, which comes with pinocchio: at this size, numpy's own solver costs ten times as much.
"""

from __future__ import annotations

from math import isfinite, nan, prod
from typing import Final

import eigenpy
import numpy as np

from srl.runtime.contracts.signals import Array

NEAR: Final = 1e-6
"""Independence below which `damped` begins to damp. A Panda in 4000 random postures has at least 7e-6."""
DAMPING: Final = 1e-6
"""The most that `damped` adds to each diagonal element, as a share of it."""


class Equations:
    """Solves A x = b. Only the lower triangle of A (6, 6) is read.

    Each user needs its own instance, as an instance has memory. A must be finite: Eigen takes other values for zero.
    """

    def __init__(self) -> None:
        self._factors = eigenpy.LDLT(6)

    def solve(self, A: Array, b: Array) -> Array:
        """Returns x (6,). A row of zeros gives zero there."""
        self._factors.compute(A)
        x: Array = self._factors.solve(b)
        return x

    def damped(self, A: Array, b: Array) -> tuple[Array, float]:
        """Solves like `solve`, with damping near a singular A, and returns x and the rows' independence.

        Near a singular A, each diagonal element grows gradually by a share of it (see NEAR, DAMPING). The
        independence is det A divided by the product of its diagonal. It is 1 if the rows don't interfere and 0 if A is
        singular. It depends neither on their units nor on their order.
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
        """Returns det A; zero if A is singular within rounding."""
        factors = self._factors
        factors.compute(A)
        return max(prod(factors.vectorD().tolist()), 0.0)
