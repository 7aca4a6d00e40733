"""Euler angles in a broadcast's order, and quaternions."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from runtime.signals import Array

Order = Literal["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]
_AXES: Final = {"X": 1, "Y": 2, "Z": 3}


class Quaternions:
    """(k, 3) angles to (k, 4) unit quaternions, w x y z: R = R_first(r1) R_second(r2) R_third(r3) (sheet, 3)."""

    def __init__(self, order: Order, count: int) -> None:
        i, j, k = (_AXES[axis] for axis in order)
        self._columns = (i, j, k)
        # sin sin sin and the like enter with the sign of the permutation.
        self._sign = 1.0 if (j - i) % 3 == 1 else -1.0
        self._half = np.empty((count, 3))
        self._cos, self._sin = np.empty((count, 3)), np.empty((count, 3))

    def fill(self, angles: Array, out: Array) -> None:
        """
        Args:
            angles: (k, 3) rad, in the order's sequence.
            out: (k, 4).
        """
        np.multiply(angles, 0.5, out=self._half)
        np.cos(self._half, out=self._cos)
        np.sin(self._half, out=self._sin)
        (c1, c2, c3), (s1, s2, s3) = self._cos.T, self._sin.T
        i, j, k = self._columns
        e = self._sign
        out[:, 0] = c1 * c2 * c3 - e * s1 * s2 * s3
        out[:, i] = s1 * c2 * c3 + e * c1 * s2 * s3
        out[:, j] = c1 * s2 * c3 - e * s1 * c2 * s3
        out[:, k] = c1 * c2 * s3 + e * s1 * s2 * c3


def angles_of(quaternions: Array, order: Order) -> Array:
    """(k, 3) rad in the order's sequence, of unit quaternions (k, 4); at gimbal lock the third is 0."""
    i, j, k = (_AXES[axis] - 1 for axis in order)
    e = 1.0 if (j - i) % 3 == 1 else -1.0
    w, x, y, z = quaternions.T
    R = np.empty((len(quaternions), 3, 3))
    R[:, 0, 0], R[:, 1, 1], R[:, 2, 2] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z), 1 - 2 * (x * x + y * y)
    R[:, 0, 1], R[:, 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    R[:, 0, 2], R[:, 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    R[:, 1, 2], R[:, 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    second = np.arcsin(np.clip(e * R[:, i, k], -1, 1))
    first = np.arctan2(-e * R[:, j, k], R[:, k, k])
    third = np.arctan2(-e * R[:, i, j], R[:, i, i])
    locked = np.abs(R[:, i, k]) > 1 - 1e-12
    first = np.where(locked, np.arctan2(e * R[:, k, j], R[:, j, j]), first)
    third = np.where(locked, 0.0, third)
    return np.stack([first, second, third], axis=1)
