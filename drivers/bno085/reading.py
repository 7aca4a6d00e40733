"""What a frame of the BNO085 says: a quaternion, the specific force, and whether the two agree.

The datasheet (1000-3927 v1.17) says that pitch turns about y and roll about x. Its own example says the opposite: at
pitch -1.10 and roll 20.85 degrees it measures (-371, -20, 977) mg, and gravity along these axes follows, to 1 mg, from
yaw about z, then pitch about x, then roll about y. That is the convention of Android, whose axes the sensor has. So
ZXY is the default, and what is measured is held against it: specific force, turned by the orientation, points up.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, radians
from typing import Final, Literal

import numpy as np

from srl.drivers.bno085.protocol import RATE, Record
from srl.drivers.gravity_check import GravityCheck
from srl.runtime.contracts.rotation import EulerQuaternions
from srl.runtime.contracts.signals import Array

AngleOrder = Literal["ZXY", "ZYX"]

MG: Final = 9.80665e-3  # m/s^2
_CENTIDEGREE: Final = radians(0.01)


class Reading:
    """Turns records into states, and judges them. Shared by the driver and its fake.

    Attributes:
        disagrees: rad, between up and the mean specific force of the last seconds.
    """

    def __init__(self, order: AngleOrder) -> None:
        self._order = order
        self._euler = EulerQuaternions(order, 1)
        self._angles, self._quaternion = np.zeros((1, 3)), np.zeros((1, 4))
        self._gravity = GravityCheck(RATE)

    @property
    def disagrees(self) -> float:
        """See the class."""
        return self._gravity.disagrees

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
        if not self._gravity.agree((w, x, y, z), force):
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
