"""Which way is up in an arm's base: measured by an inertial sensor on it, or said by the tree of frames."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from runtime.contracts.rotation import Quaternion, Vector, conjugate, product, turned
from runtime.contracts.signals import Array

_UP: Final[Vector] = (0.0, 0.0, 1.0)  # of an inertial sensor's reference, and of a world frame
_OFF: Final = 0.1  # by which a quaternion's length may be off 1


class Uprightness:
    """Up, followed by a low-pass; what isn't measured leaves it as it was.

    Attributes:
        up: (3,) unit vector in the base's axes.
        missing: s, for which it hasn't been measured; inf: never since the reset.
    """

    def __init__(self, smooth: float) -> None:
        """`smooth`: s, time constant of the low-pass."""
        self._smooth = smooth
        self.up: Array = np.array(_UP)
        self.missing = 0.0

    def reset(self, found: Vector | None) -> None:
        """Takes what is measured now, as it is."""
        self.missing = 0.0 if found is not None else float("inf")
        if found is not None:
            self.up = np.array(found)

    def update(self, found: Vector | None, dt: float) -> None:
        """Goes on for dt seconds."""
        if found is None:
            self.missing += dt
            return
        if not isfinite(self.missing):  # the first: nothing was compensated by what was before
            self.up = np.array(found)
        self.missing = 0.0
        mixed = self.up + dt / (dt + self._smooth) * (np.array(found) - self.up)
        length = float(np.linalg.norm(mixed))
        if length > 1e-6:  # else it is upside down within one cycle: not believed
            self.up = mixed / length


def by_sensor(orientation: Array, mount: Array) -> Vector | None:
    """Up in the base. None: it isn't measured.

    Args:
        orientation: (4,) w x y z of the sensor in its own upright reference.
        mount: (7,) the sensor's pose in the base.
    """
    sensor, placed = _unit(orientation), _unit(mount[3:])
    if sensor is None or placed is None:
        return None
    return turned(product(placed, conjugate(sensor)), _UP)


def by_frames(base: Array) -> Vector | None:
    """Up in the base, whose pose (7,) in an upright frame is given. None: it isn't known."""
    turn = _unit(base[3:])
    return None if turn is None else turned(conjugate(turn), _UP)


def _unit(values: Array) -> Quaternion | None:
    w, x, y, z = values.tolist()
    size = (w * w + x * x + y * y + z * z) ** 0.5
    if not isfinite(size) or abs(size - 1.0) > _OFF:
        return None
    return (w / size, x / size, y / size, z / size)
