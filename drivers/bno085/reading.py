"""What a frame of the BNO085 says: a quaternion, the specific force, and whether the two agree.

The datasheet (1000-3927 v1.17) says that pitch turns about y and roll about x. Its own example says the opposite: at
pitch -1.10 and roll 20.85 degrees it measures (-371, -20, 977) mg, and gravity along these axes follows, to 1 mg, from
yaw about z, then pitch about x, then roll about y. That is the convention of Android, whose axes the sensor has. So
ZXY is the default, and what is measured is held against it: specific force, turned by the orientation, points up.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import acos, cos, degrees, radians
from typing import Final, Literal

import numpy as np

from drivers.bno085.protocol import RATE, Record
from runtime.contracts.rotation import EulerQuaternions, Vector, turned
from runtime.contracts.signals import Array

AngleOrder = Literal["ZXY", "ZYX"]

MG: Final = 9.80665e-3  # m/s^2
_CENTIDEGREE: Final = radians(0.01)
_TAU: Final = 5.0  # s, over which the acceleration of motion averages out, also of walking in a circle
_ENOUGH: Final = round(_TAU * RATE)  # frames before the mean is judged
DISAGREE: Final = radians(12.0)  # a sensor at rest is 1.5 degrees off, in motion 2.5 (datasheet, figure 6-12)


class Reading:
    """Turns records into states, and judges them. Shared by the driver and its fake.

    Attributes:
        disagrees: rad, between up and the mean specific force of the last seconds.
    """

    def __init__(self, order: AngleOrder) -> None:
        self._order = order
        self._euler = EulerQuaternions(order, 1)
        self._angles, self._quaternion = np.zeros((1, 3)), np.zeros((1, 4))
        self._mean: Vector = (0.0, 0.0, 0.0)
        self._count = 0
        self.disagrees = 0.0

    def fill(self, record: Record, states: Mapping[str, Array]) -> bool:
        """Fills `orientation` and `acceleration`.

        Returns:
            False if angles and acceleration disagree; then nothing is filled.
        """
        self._angles[0] = record.yaw, record.pitch, record.roll
        self._angles *= _CENTIDEGREE
        self._euler.fill(self._angles, self._quaternion)
        w, x, y, z = self._quaternion[0].tolist()
        force = (MG * record.x, MG * record.y, MG * record.z)
        if not self._agree(turned((w, x, y, z), force)):
            return False
        states["orientation"][:] = w, x, y, z
        states["acceleration"][:] = force
        return True

    def trouble(self) -> str:
        """Why a record wasn't used, and what to do."""
        other = "ZYX" if self._order == "ZXY" else "ZXY"
        return (
            f"angles and acceleration disagree by {degrees(self.disagrees):.0f} degrees: "
            f"try 'order: {other}'; if that doesn't help, the sensor is broken"
        )

    def _agree(self, up: Vector) -> bool:
        self._count += 1
        share = max(1.0 / self._count, 1.0 / _ENOUGH)
        x, y, z = (m + share * (u - m) for m, u in zip(self._mean, up, strict=True))
        self._mean = x, y, z
        size = (x * x + y * y + z * z) ** 0.5
        self.disagrees = acos(max(-1.0, min(1.0, z / size))) if size > 0.0 else 0.0
        return self._count < _ENOUGH or (size > 0.0 and z >= size * cos(DISAGREE))


def expire(states: Mapping[str, Array]) -> None:
    """What isn't measured is no orientation."""
    for state in states.values():
        state.fill(np.nan)
