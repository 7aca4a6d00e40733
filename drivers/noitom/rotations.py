"""Euler angles in a broadcast's order, and quaternions."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from runtime.contracts.signals import Array

Order = Literal["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]
_AXES: Final = {"X": 1, "Y": 2, "Z": 3}


class Quaternions:
    """(k, 3) angles to (k, 4) unit quaternions, w x y z: R = R_first(r1) R_second(r2) R_third(r3) (sheet, 3)."""

    def __init__(self, order: Order, count: int) -> None:
        i, j, k = (_AXES[axis] for axis in order)
        # sin sin sin and the like enter with the sign of the permutation.
        e = 1.0 if (j - i) % 3 == 1 else -1.0
        # Of the eight products of three, by bits (1: the sine): those of w, x, y, z, and what is added to each.
        first, second, sign = np.empty(4, np.intp), np.empty(4, np.intp), np.empty((4, 1))
        first[[0, i, j, k]] = 0b000, 0b100, 0b010, 0b001
        second[:] = 0b111 - first
        sign[[0, i, j, k], 0] = -e, e, -e, e
        self._first, self._second, self._sign = first, second, sign
        self._half, self._each = np.empty((3, count)), np.empty((3, 2, count))
        self._two, self._three = np.empty((2, 2, 1, count)), np.empty((2, 2, 2, count))
        self._sum, self._added = np.empty((4, count)), np.empty((4, count))

    def fill(self, angles: Array, out: Array) -> None:
        """
        Args:
            angles: (k, 3) rad, in the order's sequence.
            out: (k, 4).
        """
        each = self._each
        np.multiply(angles.T, 0.5, out=self._half)
        np.cos(self._half, out=each[:, 0])
        np.sin(self._half, out=each[:, 1])
        np.multiply(each[0, :, None, None], each[1, None, :, None], out=self._two)
        np.multiply(self._two, each[2], out=self._three)
        products = self._three.reshape(8, -1)
        products.take(self._first, axis=0, out=self._sum, mode="clip")
        products.take(self._second, axis=0, out=self._added, mode="clip")
        self._added *= self._sign
        np.add(self._sum, self._added, out=out.T)


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
