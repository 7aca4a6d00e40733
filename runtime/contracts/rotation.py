"""Rotations as unit quaternions (w, x, y, z) and rotation vectors (axis times angle, rad).

Plain numbers instead of arrays: for four values numpy's own overhead is most of the price.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from runtime.contracts.signals import Array

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def normalised(q: Quaternion) -> Quaternion:
    """Of length 1; the identity for one without length."""
    size = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if size < 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)


def exp(x: float, y: float, z: float) -> Quaternion:
    """The rotation by a rotation vector."""
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        return normalised((1.0, x / 2, y / 2, z / 2))
    s = sin(angle / 2) / angle
    return (cos(angle / 2), s * x, s * y, s * z)


def log(q: Quaternion) -> Vector:
    """The rotation vector of the shorter way round, its angle at most pi."""
    w, x, y, z = q
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    size = sqrt(x * x + y * y + z * z)
    if size < 1e-9:
        return (2 * x, 2 * y, 2 * z)
    angle = 2 * atan2(size, w) / size
    return (angle * x, angle * y, angle * z)


def turned(q: Quaternion, v: Vector) -> Vector:
    """The vector v turned by q."""
    w, x, y, z = q
    a, b, c = v
    # t = 2 q x v;  v' = v + w t + q x t
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def from_matrix(R: Array) -> Quaternion:
    """Of a rotation matrix (3, 3), with w >= 0."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    # The largest of the four is found first; dividing by a small one would lose digits.
    trace = a + e + i
    if trace >= max(a, e, i):
        q = (1 + trace, h - f, c - g, d - b)
    elif a >= max(e, i):
        q = (h - f, 1 + a - e - i, b + d, c + g)
    elif e >= i:
        q = (c - g, b + d, 1 + e - a - i, f + h)
    else:
        q = (d - b, c + g, f + h, 1 + i - a - e)
    q = normalised(q)
    return q if q[0] >= 0 else (-q[0], -q[1], -q[2], -q[3])


def matrix(q: Quaternion) -> Array:
    """(3, 3)."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def error(desired: Quaternion, actual: Quaternion) -> Vector:
    """The rotation vector, in the common frame's axes, that turns `actual` into `desired`."""
    return log(product(desired, conjugate(actual)))
