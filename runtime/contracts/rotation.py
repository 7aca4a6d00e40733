"""Poses and rotations: unit quaternions (w, x, y, z), rotation vectors (axis times angle, rad), matrices, Euler angles.

Functions that run once a cycle take plain numbers instead of arrays: for four values, numpy's own overhead is
most of the cost. Functions for many rotations at once take arrays.
"""

from __future__ import annotations

from math import asin, atan2, cos, isfinite, pi, sin, sqrt
from typing import Final, Literal, TypeVar

import numpy as np

from srl.runtime.contracts.signals import Array

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
Pose = tuple[float, float, float, float, float, float, float]
Order = Literal["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]  # Euler angles: R = R_first(r1) R_second(r2) R_third(r3)
T = TypeVar("T", float, Array)

# Of each order, the numbers of its axes, and the sign of the permutation.
_TURNS: Final = {
    "XYZ": (0, 1, 2, 1.0), "YZX": (1, 2, 0, 1.0), "ZXY": (2, 0, 1, 1.0),
    "XZY": (0, 2, 1, -1.0), "YXZ": (1, 0, 2, -1.0), "ZYX": (2, 1, 0, -1.0),
}  # fmt: skip


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation b followed by the rotation a."""
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
    """The quaternion scaled to length 1; the identity if it has no length."""
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
    """The rotation vector of a unit quaternion the shorter way round: its angle is at most pi."""
    w, x, y, z = q
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    size = sqrt(x * x + y * y + z * z)
    if size < 1e-9:
        return (2 * x, 2 * y, 2 * z)
    angle = 2 * atan2(size, w) / size
    return (angle * x, angle * y, angle * z)


def log_nearest(q: Quaternion, to: Vector) -> Vector:
    """The rotation vector of a unit quaternion that is nearest to another one, `to`.

    Followed from one instant to the next it has no jump at pi: it goes on to larger angles. Near a full turn every
    axis means the same rotation; from there on nothing tells which way it goes on. If `to` isn't finite: as `log`.
    """
    x, y, z = log(q)
    a, b, c = to
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        size = sqrt(a * a + b * b + c * c)
        k = round(size / (2 * pi)) * 2 * pi if isfinite(size) else 0.0
        return (x + k * a / size, y + k * b / size, z + k * c / size) if k else (x, y, z)
    turns = ((x * a + y * b + z * c) / angle - angle) / (2 * pi)
    k = 1.0 + 2 * pi / angle * round(turns) if isfinite(turns) else 1.0
    return (k * x, k * y, k * z)


def turned(q: Quaternion, v: Vector) -> Vector:
    """The vector v rotated by q."""
    w, x, y, z = q
    a, b, c = v
    # t = 2 q x v;  v' = v + w t + q x t
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def of_rows(a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float) -> Quaternion:
    """The unit quaternion of a rotation matrix by rows, ((a, b, c), (d, e, f), (g, h, i)).

    It may be either of the two quaternions that mean this rotation, q or -q.
    """
    # The largest of the four elements is found first: dividing by a small one would lose digits.
    trace = a + e + i
    if trace >= max(a, e, i):
        return normalised((1 + trace, h - f, c - g, d - b))
    if a >= max(e, i):
        return normalised((h - f, 1 + a - e - i, b + d, c + g))
    if e >= i:
        return normalised((c - g, b + d, 1 + e - a - i, f + h))
    return normalised((d - b, c + g, f + h, 1 + i - a - e))


def from_matrix(R: Array) -> Quaternion:
    """The unit quaternion of a rotation matrix (3, 3), with w >= 0."""
    q = of_rows(*R.ravel().tolist())
    return q if q[0] >= 0 else (-q[0], -q[1], -q[2], -q[3])


def nearer(q: Quaternion, to: Quaternion) -> Quaternion:
    """Returns q or -q, whichever is nearer to `to`. Both mean the same rotation."""
    # Written so that q is returned where `to` isn't a number.
    return (-q[0], -q[1], -q[2], -q[3]) if q[0] * to[0] + q[1] * to[1] + q[2] * to[2] + q[3] * to[3] < 0 else q


def rows(w: T, x: T, y: T, z: T) -> list[list[T]]:
    """The rotation matrix of a unit quaternion, by rows. The elements may be numbers or arrays of numbers."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def matrix(q: Quaternion) -> Array:
    """The rotation matrix (3, 3) of a unit quaternion."""
    return np.array(rows(*q))


def matrices(quaternions: Array) -> Array:
    """The rotation matrices (k, 3, 3) of unit quaternions (k, 4)."""
    return np.moveaxis(np.array(rows(*quaternions.T)), 2, 0)


def yaw(w: float, x: float, y: float, z: float) -> float:
    """The yaw of a unit quaternion, rad: as seen from above, the angle of its x axis in the x-y plane."""
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def error(desired: Quaternion, actual: Quaternion) -> Vector:
    """The rotation vector, in the common frame's axes, that rotates `actual` into `desired`."""
    return log(product(desired, conjugate(actual)))


def from_euler_xyz(x: float, y: float, z: float) -> Quaternion:
    """The unit quaternion of Rx(x) Ry(y) Rz(z), angles in rad."""
    cx, cy, cz = cos(x / 2), cos(y / 2), cos(z / 2)
    sx, sy, sz = sin(x / 2), sin(y / 2), sin(z / 2)
    return (
        cx * cy * cz - sx * sy * sz,
        sx * cy * cz + cx * sy * sz,
        cx * sy * cz - sx * cy * sz,
        cx * cy * sz + sx * sy * cz,
    )


class EulerQuaternions:
    """Converts Euler angles (k, 3) in an order to unit quaternions (k, 4), without allocating."""

    def __init__(self, order: Order, count: int, unit: float = 1.0) -> None:
        """`unit`: rad per unit of the angles."""
        self._unit = 0.5 * unit
        i, j, k, e = _TURNS[order]
        i, j, k = i + 1, j + 1, k + 1  # of a quaternion's elements
        # The second terms (sin sin sin for w, and so on) have the sign of the permutation.
        # Each component w, x, y, z is a sum of two of the eight products of three factors. The index of a
        # product has one bit per factor (1: the sine). `first` and `second` are the indices of the two terms.
        first, second, sign = np.empty(4, np.intp), np.empty(4, np.intp), np.empty((4, 1))
        first[[0, i, j, k]] = 0b000, 0b100, 0b010, 0b001
        second[:] = 0b111 - first
        sign[[0, i, j, k], 0] = -e, e, -e, e
        self._first, self._second, self._sign = first, second, sign
        self._half, self._each = np.empty((3, count)), np.empty((3, 2, count))
        self._two, self._three = np.empty((2, 2, 1, count)), np.empty((2, 2, 2, count))
        self._sum, self._added = np.empty((4, count)), np.empty((4, count))

    def fill(self, angles: Array, out: Array) -> None:
        """Fills `out` with the quaternions of `angles`.

        Args:
            angles: (k, 3) rad, or the unit given, in the order's sequence.
            out: (k, 4).
        """
        each = self._each
        np.multiply(angles.T, self._unit, out=self._half)
        np.cos(self._half, out=each[:, 0])
        np.sin(self._half, out=each[:, 1])
        np.multiply(each[0, :, None, None], each[1, None, :, None], out=self._two)
        np.multiply(self._two, each[2], out=self._three)
        products = self._three.reshape(8, -1)
        products.take(self._first, axis=0, out=self._sum, mode="clip")
        products.take(self._second, axis=0, out=self._added, mode="clip")
        self._added *= self._sign
        np.add(self._sum, self._added, out=out.T)


def euler_angles(R: Array, order: Order) -> Array:
    """Euler angles (k, 3), rad, in the order's sequence, of rotation matrices (k, 3, 3).

    At gimbal lock the third angle is 0.
    """
    i, j, k, e = _TURNS[order]
    second = np.arcsin(np.clip(e * R[:, i, k], -1, 1))
    first = np.arctan2(-e * R[:, j, k], R[:, k, k])
    third = np.arctan2(-e * R[:, i, j], R[:, i, i])
    locked = np.abs(R[:, i, k]) > 1 - 1e-12
    first = np.where(locked, np.arctan2(e * R[:, k, j], R[:, j, j]), first)
    third = np.where(locked, 0.0, third)
    return np.stack([first, second, third], axis=1)


def euler(R: Array, order: Order) -> Vector:
    """As `euler_angles`, of one rotation matrix (3, 3)."""
    i, j, k, e = _TURNS[order]
    rows = R.tolist()
    second = asin(min(max(e * rows[i][k], -1.0), 1.0))
    if abs(rows[i][k]) > 1 - 1e-12:
        return (atan2(e * rows[k][j], rows[j][j]), second, 0.0)
    return (atan2(-e * rows[j][k], rows[k][k]), second, atan2(-e * rows[i][j], rows[i][i]))


def about_axis(axis: int, angle: Array) -> Array:
    """The matrices (k, 3, 3) of right-handed rotations by angles (k,), rad, about coordinate axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.zeros((angle.size, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1.0
    R[:, i, i], R[:, i, j], R[:, j, i], R[:, j, j] = c, -s, s, c
    return R


def from_z(directions: Array) -> Array:
    """(n, 4): the shortest turns that take z to directions (n, 3) of any length; none for a length of zero."""
    length = np.linalg.norm(directions, axis=1)
    x, y, z = np.where(length[:, None] > 0.0, directions / np.where(length, length, 1.0)[:, None], (0.0, 0.0, 1.0)).T
    q = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    q[z < -1.0 + 1e-12] = 0.0, 1.0, 0.0, 0.0  # straight back: about x
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """The unit quaternion of Rz(yaw) Ry(pitch) Rx(roll), rad, about fixed axes."""
    return product((cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)), product((cos(pitch / 2), 0.0, sin(pitch / 2), 0.0),
                   (cos(roll / 2), sin(roll / 2), 0.0, 0.0)))  # fmt: skip


# Rigid transforms are poses: x, y, z (m), w, x, y, z, as in `srl.runtime.contracts.terms.POSE`.


def composed(a: Pose, b: Pose) -> Pose:
    """The pose in the outer frame of what has the pose b in the frame that has the pose a."""
    q = (a[3], a[4], a[5], a[6])
    x, y, z = turned(q, (b[0], b[1], b[2]))
    return (a[0] + x, a[1] + y, a[2] + z, *product(q, (b[3], b[4], b[5], b[6])))


def inverted(a: Pose) -> Pose:
    """The pose of the outer frame in the frame that has the pose a."""
    q = (a[3], -a[4], -a[5], -a[6])
    x, y, z = turned(q, (a[0], a[1], a[2]))
    return (-x, -y, -z, *q)


def homogeneous(pose: Pose | Array) -> Array:
    """The (4, 4) matrix T of a pose, p_outer = T p_inner; the quaternion is normalised first."""
    x, y, z, *q = pose.tolist() if isinstance(pose, np.ndarray) else pose
    made = np.eye(4)
    made[:3, :3] = matrix(normalised((q[0], q[1], q[2], q[3])))
    made[:3, 3] = x, y, z
    return made
