"""Vectors and symmetric 3 x 3 matrices in plain numbers: a call of numpy costs more than their arithmetic."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from runtime.contracts.signals import Array

Vector = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]  # xx, xy, xz, yy, yz, zz

FIRM: Final = 1e-3  # of the trace: closed forms are used only if all eigenvalues are above this
_ROUNDING: Final = 1e-12  # relative, of a minor; more than that of its products


def dot(a: Vector, b: Vector) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def gram(vectors: Iterable[Vector]) -> Symmetric:
    """The sum of v v^T."""
    xx = xy = xz = yy = yz = zz = 0.0
    for x, y, z in vectors:
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    return xx, xy, xz, yy, yz, zz


def is_above(M: Symmetric, floor: float) -> bool:
    """Whether all eigenvalues are greater than `floor`: M - floor I is positive definite (Sylvester).

    Minors that are no more than their rounding count as zero, so the answer may be no for eigenvalues just above.
    """
    xx, xy, xz, yy, yz, zz = M
    xx, yy, zz = xx - floor, yy - floor, zz - floor
    minor = xx * yy - xy * xy
    return (
        xx > 0.0
        and minor > _ROUNDING * xx * yy
        and zz * minor > xx * yz * yz - 2.0 * xy * xz * yz + yy * xz * xz + _ROUNDING * abs(zz) * xx * yy
    )


def inverse(M: Symmetric) -> Symmetric:
    """The inverse by cofactors, for M with all eigenvalues above FIRM of the trace."""
    xx, xy, xz, yy, yz, zz = M
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    k = 1.0 / (xx * a + xy * b + xz * c)
    return a * k, b * k, c * k, (xx * zz - xz * xz) * k, (xy * xz - xx * yz) * k, (xx * yy - xy * xy) * k


def raised_inverse(M: Symmetric, floor: float) -> Symmetric:
    """The inverse of M >= 0 after its eigenvalues below `floor` > 0 have been raised to `floor`."""
    if is_above(M, max(floor, FIRM * (M[0] + M[3] + M[5]))):
        return inverse(M)
    lam, U = np.linalg.eigh(full(M))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = ((U / np.maximum(lam, floor)) @ U.T).tolist()
    return xx, xy, xz, yy, yz, zz


def full(M: Symmetric) -> Array:
    """M as an array (3, 3)."""
    xx, xy, xz, yy, yz, zz = M
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def times(M: Symmetric, v: Vector) -> Vector:
    """M v"""
    xx, xy, xz, yy, yz, zz = M
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
