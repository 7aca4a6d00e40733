"""Converts rotations as received to unit quaternions (w, x, y, z)."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Final

from srl.runtime.contracts import rotation
from srl.runtime.contracts.rotation import Quaternion

_CLOSE: Final = 1e-2  # tolerance for a rotation matrix; float32 or rounded text stays within it


def from_matrix(r: Sequence[float]) -> Quaternion | None:
    """Returns the quaternion of a rotation matrix, nine numbers row by row; None if it isn't a rotation."""
    a, b, c, d, e, f, g, h, i = r
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    lengths = (a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i)
    if not abs(determinant - 1.0) < _CLOSE or not all(abs(length - 1.0) < _CLOSE for length in lengths):
        return None  # also for NaN
    return rotation.of_rows(a, b, c, d, e, f, g, h, i)


def from_euler_xyz(x: float, y: float, z: float) -> Quaternion | None:
    """Returns the quaternion of Rx(x) Ry(y) Rz(z), rad; None if a value isn't finite."""
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        return None
    return rotation.from_euler_xyz(x, y, z)
