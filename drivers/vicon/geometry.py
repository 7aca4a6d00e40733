"""Rotations as the wires give them, turned into unit quaternions (w, x, y, z)."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Final

from runtime.contracts import rotation
from runtime.contracts.rotation import Quaternion

_CLOSE: Final = 1e-2  # how far a matrix may be from a rotation; f32 or a rounded text isn't further


def from_matrix(r: Sequence[float]) -> Quaternion | None:
    """Of a rotation matrix, nine numbers row by row; None for what is no rotation."""
    a, b, c, d, e, f, g, h, i = r
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    lengths = (a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i)
    if not abs(determinant - 1.0) < _CLOSE or not all(abs(length - 1.0) < _CLOSE for length in lengths):
        return None  # also for NaN
    return rotation.of_rows(a, b, c, d, e, f, g, h, i)


def from_euler_xyz(x: float, y: float, z: float) -> Quaternion | None:
    """Of Rx(x) Ry(y) Rz(z), rad; None if one isn't finite."""
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        return None
    return rotation.from_euler_xyz(x, y, z)


def z_up_point(p: Sequence[float]) -> tuple[float, float, float]:
    """A point of a y-up server (x forward, y up, z right) in x forward, y left, z up (A.4)."""
    return p[0], -p[2], p[1]


def z_up_quaternion(q: Quaternion) -> Quaternion:
    """The same for a rotation. World and body axes are renamed alike, so an unturned body stays unturned."""
    w, x, y, z = q
    return w, x, -z, y
