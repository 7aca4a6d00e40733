"""Whether an inertial sensor's angles and acceleration agree: specific force, turned by the orientation, points up."""

from __future__ import annotations

from math import acos, cos, radians
from typing import Final

from srl.runtime.contracts.rotation import Quaternion, Vector, turned

_TAU: Final = 5.0  # s, over which the acceleration of motion averages out, also of walking in a circle
MOST: Final = 4e3  # m/s^2
DISAGREE: Final = radians(12.0)  # a sensor at rest is 1.5 degrees off, in motion 2.5 (BNO08X datasheet, figure 6-12)


class GravityCheck:
    """Judges the mean of the last seconds.

    Attributes:
        disagrees: rad, between up and the mean specific force.
    """

    def __init__(self, rate: float) -> None:
        """`rate`: Hz, of the samples."""
        self._enough = round(_TAU * rate)  # samples before the mean is judged
        self._mean: Vector = (0.0, 0.0, 0.0)
        self._count = 0
        self.disagrees = 0.0

    def agree(self, orientation: Quaternion, force: Vector) -> bool:
        """Takes a sample: w x y z of the sensor in a frame with z up, and m/s^2 in the sensor's axes.

        A force beyond all reason isn't averaged: one would take minutes to be forgotten.
        """
        if not sum(map(abs, force)) < MOST:  # nor NaN
            return True
        up = turned(orientation, force)
        self._count += 1
        share = max(1.0 / self._count, 1.0 / self._enough)
        x, y, z = (m + share * (u - m) for m, u in zip(self._mean, up, strict=True))
        self._mean = x, y, z
        size = (x * x + y * y + z * z) ** 0.5
        self.disagrees = acos(max(-1.0, min(1.0, z / size))) if size > 0.0 else 0.0
        return self._count < self._enough or (size > 0.0 and z >= size * cos(DISAGREE))
