"""Turns that devices and frames give, of which some are none."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Final

from srl.runtime.contracts.rotation import Quaternion

_OFF: Final = 0.1  # by which a quaternion's length may be off 1


def measured_turn(values: Sequence[float]) -> Quaternion | None:
    """A measured quaternion w x y z, scaled to length 1; None if it is none: NaN, or zeros while nothing is tracked."""
    w, x, y, z = values
    size = (w * w + x * x + y * y + z * z) ** 0.5
    if not isfinite(size) or abs(size - 1.0) > _OFF:
        return None
    return (w / size, x / size, y / size, z / size)
