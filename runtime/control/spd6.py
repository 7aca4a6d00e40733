"""Linear equations with a symmetric positive definite 6 x 6 matrix, in plain numbers.

Written out: at this size a call of a linear algebra library costs more than the 60 multiplications.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

Rows = Sequence[Sequence[float]]

NEAR: Final = 1e-6
"""Independence below which `damped` begins to damp; a Panda in 4000 random postures has 7e-6 at least."""
DAMPING: Final = 1e-6
"""What it adds at most to each diagonal element, as a share of it."""
TINY: Final = 1e-16
"""Least pivot, as a share of the diagonal element: what rounding leaves of a zero one."""
LEAST: Final = 1e-12
"""Least diagonal element."""


class Solution(NamedTuple):
    """x (6,) with A x = b; `independence` in 0..1: det A over the product of its diagonal.

    Independence is 1 where the rows don't interfere and 0 where A is singular. It doesn't depend on the units of
    the rows, nor on their order.
    """

    x: tuple[float, float, float, float, float, float]
    independence: float


def solve(A: Rows, b: Sequence[float]) -> Solution:
    """By A = L D L^T; of A only the lower triangle is read. A row of zeros gives x = 0 there if b is 0."""
    r0, r1, r2, r3, r4, r5 = A
    a00, a11, a22, a33, a44, a55 = r0[0], r1[1], r2[2], r3[3], r4[4], r5[5]
    if min(a00, a11, a22, a33, a44, a55) < LEAST:
        A = [[*row[:i], max(row[i], LEAST), *row[i + 1 :]] for i, row in enumerate(A)]
        return Solution(solve(A, b).x, 0.0)
    d0 = a00
    b10, b20, b30, b40, b50 = r1[0], r2[0], r3[0], r4[0], r5[0]
    l10, l20, l30, l40, l50 = b10 / d0, b20 / d0, b30 / d0, b40 / d0, b50 / d0

    d1 = a11 - l10 * b10
    d1 = max(d1, TINY * a11)
    b21, b31, b41, b51 = r2[1] - l20 * b10, r3[1] - l30 * b10, r4[1] - l40 * b10, r5[1] - l50 * b10
    l21, l31, l41, l51 = b21 / d1, b31 / d1, b41 / d1, b51 / d1

    d2 = a22 - l20 * b20 - l21 * b21
    d2 = max(d2, TINY * a22)
    b32 = r3[2] - l30 * b20 - l31 * b21
    b42 = r4[2] - l40 * b20 - l41 * b21
    b52 = r5[2] - l50 * b20 - l51 * b21
    l32, l42, l52 = b32 / d2, b42 / d2, b52 / d2

    d3 = a33 - l30 * b30 - l31 * b31 - l32 * b32
    d3 = max(d3, TINY * a33)
    b43 = r4[3] - l40 * b30 - l41 * b31 - l42 * b32
    b53 = r5[3] - l50 * b30 - l51 * b31 - l52 * b32
    l43, l53 = b43 / d3, b53 / d3

    d4 = a44 - l40 * b40 - l41 * b41 - l42 * b42 - l43 * b43
    d4 = max(d4, TINY * a44)
    b54 = r5[4] - l50 * b40 - l51 * b41 - l52 * b42 - l53 * b43
    l54 = b54 / d4

    d5 = a55 - l50 * b50 - l51 * b51 - l52 * b52 - l53 * b53 - l54 * b54
    d5 = max(d5, TINY * a55)

    y0 = b[0]
    y1 = b[1] - l10 * y0
    y2 = b[2] - l20 * y0 - l21 * y1
    y3 = b[3] - l30 * y0 - l31 * y1 - l32 * y2
    y4 = b[4] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
    y5 = b[5] - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4

    x5 = y5 / d5
    x4 = y4 / d4 - l54 * x5
    x3 = y3 / d3 - l43 * x4 - l53 * x5
    x2 = y2 / d2 - l32 * x3 - l42 * x4 - l52 * x5
    x1 = y1 / d1 - l21 * x2 - l31 * x3 - l41 * x4 - l51 * x5
    x0 = y0 / d0 - l10 * x1 - l20 * x2 - l30 * x3 - l40 * x4 - l50 * x5
    # Pivot by pivot, so that no product of many small numbers underflows.
    share = d1 / a11 * (d2 / a22) * (d3 / a33)
    return Solution((x0, x1, x2, x3, x4, x5), share * (d4 / a44) * (d5 / a55))


def damped(A: Rows, b: Sequence[float]) -> Solution:
    """As `solve`; near a singular A each diagonal element grows by a share of it, gradually (see NEAR, DAMPING)."""
    found = solve(A, b)
    if found.independence >= NEAR:
        return found
    away = 1.0 - found.independence / NEAR
    grown = 1.0 + DAMPING * away * away
    rows = [[*row[:i], grown * row[i], *row[i + 1 :]] for i, row in enumerate(A)]
    return Solution(solve(rows, b).x, found.independence)


def determinant(A: Rows) -> float:
    """det A; zero where A is singular within rounding."""
    product = solve(A, (0.0,) * 6).independence
    for i, row in enumerate(A):
        product *= row[i]
    return product
