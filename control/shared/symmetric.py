"""Vectors and 3 x 3 matrices in plain numbers: a call of numpy costs more than their arithmetic.

The order of each sum is written out, as C has it: numpy's products give other last bits on other processors.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import sqrt
from typing import Final

Vector = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]  # xx, xy, xz, yy, yz, zz

FIRM: Final = 1e-3  # of the trace: closed forms are used only if all eigenvalues are above this
_ROUNDING: Final = 1e-12  # relative, of a minor; more than that of its products
_SMALL: Final = 1e-17  # of the trace: what is less beside the diagonal is below its last bit
_TURNS: Final = 30  # of Jacobi's; a dozen reach the last bit


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


def products(a: Iterable[Sequence[float]], b: Iterable[Sequence[float]]) -> tuple[Vector, Vector, Vector]:
    """The sum of a b^T over pairs, by rows."""
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for (px, py, pz), (qx, qy, qz) in zip(a, b, strict=True):
        xx, xy, xz = xx + px * qx, xy + px * qy, xz + px * qz
        yx, yy, yz = yx + py * qx, yy + py * qy, yz + py * qz
        zx, zy, zz = zx + pz * qx, zy + pz * qy, zz + pz * qz
    return (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)


def mean(vectors: Sequence[Sequence[float]]) -> Vector:
    """Their sum through their number."""
    x = y = z = 0.0
    for px, py, pz in vectors:
        x, y, z = x + px, y + py, z + pz
    n = len(vectors)
    return x / n, y / n, z / n


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
    xx = xy = xz = yy = yz = zz = 0.0
    for value, (x, y, z) in eigen(M):
        k = 1.0 / max(value, floor)
        xx, xy, xz = xx + k * x * x, xy + k * x * y, xz + k * x * z
        yy, yz, zz = yy + k * y * y, yz + k * y * z, zz + k * z * z
    return xx, xy, xz, yy, yz, zz


def eigen(M: Symmetric) -> tuple[tuple[float, Vector], ...]:
    """The three eigenvalues, each with its unit eigenvector, in no order: Jacobi's rotations (Golub and Van Loan).

    Each turns u and v until M has nothing between them; then the next pair takes their place.
    """
    a, ab, ca, b, bc, c = M
    u, v, w = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    small = _SMALL * (abs(a) + abs(b) + abs(c))
    for _ in range(_TURNS):
        if abs(ab) <= small and abs(bc) <= small and abs(ca) <= small:
            break
        if abs(ab) > small:
            h = (b - a) / (2.0 * ab)
            t = 1.0 / (abs(h) + sqrt(h * h + 1.0))
            t = -t if h < 0.0 else t
            cosine = 1.0 / sqrt(t * t + 1.0)
            sine = t * cosine
            a, b, ab = a - t * ab, b + t * ab, 0.0
            ca, bc = cosine * ca - sine * bc, sine * ca + cosine * bc
            (ux, uy, uz), (vx, vy, vz) = u, v
            u = cosine * ux - sine * vx, cosine * uy - sine * vy, cosine * uz - sine * vz
            v = sine * ux + cosine * vx, sine * uy + cosine * vy, sine * uz + cosine * vz
        a, b, c, ab, bc, ca, u, v, w = b, c, a, bc, ca, ab, v, w, u
    return (a, u), (b, v), (c, w)


def times(M: Symmetric, v: Vector) -> Vector:
    """M v"""
    xx, xy, xz, yy, yz, zz = M
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
