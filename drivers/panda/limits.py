"""The limits a Franka robot sets for its commands; beyond these it stops with a reflex.

Sources: sheet panda (FER) and sheet franka-fci, section 6 (FR3). From libfranka 0.10 on its tables are the FR3's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Kind, Limits

DT: Final = 1e-3  # s between states
TORQUE_RATE: Final = 1000.0  # N m/s
# The share of the robot's limits that is used. Rounding on the wire must not look like more. And a command that
# arrives late may be taken after the robot has replaced it, which causes up to four times its jerk. An FR3's float32
# rounds an angle beyond 4 rad by up to 2.4e-7 rad: as an acceleration, 0.24 rad/s^2 of its 10.
ACCELERATION: Final = 0.97
JERK: Final = 0.24
TORQUE: Final = 0.999
_BRAKE: Final = 0.9  # share of the acceleration for slowing down towards the end of a joint
_SHORT: Final = 2e-4  # rad before the end of a joint at which a motion stops
_AHEAD: Final = 33e-3  # s until a new velocity bound is reached: jerk, the robot's own cycle, 19 lost packets


@dataclass(frozen=True)
class RobotLimits:
    """Limits of the seven joints: rad, rad/s, rad/s^2, rad/s^3, N m.

    `offset` (rad/s) and `deceleration` (rad/s^2) shape the velocity limit of an FR3 towards a joint's end:
    v = sqrt(2 deceleration distance) - offset, between 0 and `velocity`. A Panda (FER) has the same limit at any angle.
    """

    name: str
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    effort: tuple[float, ...]
    offset: tuple[float, ...] | None = None
    deceleration: tuple[float, ...] | None = None

    @cached_property
    def _far(self) -> tuple[float, ...]:
        """Distances (rad) from which on `approach` gives the full velocity."""
        grid = [0.01 * k for k in range(700)]
        return tuple(next(d for d in grid if self.approach(i, d) >= self.velocity[i]) for i in range(7))

    def fastest(self, i: int, distance: float) -> float:
        """Returns the robot's velocity limit (rad/s, not below 0) of joint i for an end that is `distance` rad away."""
        if self.offset is None or self.deceleration is None:
            return self.velocity[i]
        return min(max(sqrt(2 * self.deceleration[i] * max(distance, 0.0)) - self.offset[i], 0.0), self.velocity[i])

    def approach(self, i: int, distance: float) -> float:
        """Returns the velocity (rad/s) with which joint i can still obey `fastest` and stop before an end.

        Near the end it is that limit itself, if braking along it takes no more than the joint's deceleration.
        Further away it is the velocity from which the joint can still slow down to it.

        Args:
            i: number of the joint.
            distance: rad to the end.
        """
        brake = _BRAKE * self.acceleration[i]
        free, speed = 0.0, 0.0  # the point where the robot's curve is left, and the velocity there
        if self.offset is not None and self.deceleration is not None:
            offset, curve = self.offset[i], self.deceleration[i]
            # Along the curve v falls at deceleration v / (v + offset): above some v it can be too steep.
            if curve > brake:
                speed = brake * offset / (curve - brake)
                free = (speed + offset) ** 2 / (2 * curve)
            if curve <= brake or distance <= free:
                return self.fastest(i, distance)
        return min(sqrt(speed * speed + 2 * brake * max(distance - free, 0.0)), self.velocity[i])

    def bounds(self, i: int, q: float, dq: float, late: float = 0.0) -> tuple[float, float]:
        """Returns the lowest and the highest velocity to aim at for joint i at q (rad) and dq (rad/s).

        `late`: s by which commands take longer than they should.
        """
        ahead, far, V = q + dq * (_AHEAD + late), self._far[i], self.velocity[i]
        down, up = ahead - self.lower[i] - _SHORT, self.upper[i] - ahead - _SHORT
        # Mostly both ends are far away. The shortcut matters: this runs for each joint, each millisecond.
        return -V if down > far else -self.approach(i, down), V if up > far else self.approach(i, up)

    def of(self, kind: Kind) -> Limits:
        """Returns the limits in the guard's form, reduced to the share that the driver uses."""
        rate = np.full(7, TORQUE * TORQUE_RATE) if kind is Kind.TORQUE else None
        return Limits(
            lower=np.array(self.lower),
            upper=np.array(self.upper),
            velocity=np.array(self.velocity),
            acceleration=ACCELERATION * np.array(self.acceleration),
            jerk=JERK * np.array(self.jerk),
            effort=np.array(self.effort),
            effort_rate=rate,
        )


PANDA: Final = RobotLimits(
    name="Panda (FER)",
    lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    velocity=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    acceleration=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    jerk=(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
    effort=(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
)
FR3: Final = RobotLimits(
    name="Franka Research 3",
    lower=(-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508),
    upper=(2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508),
    velocity=(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    acceleration=(10.0,) * 7,
    jerk=(5000.0,) * 7,
    effort=(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    offset=(0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628),
    deceleration=(6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0),
)
BY_VERSION: Final = {5: PANDA, 10: FR3}
"""The FER never gets past protocol 5, and only the FR3 speaks 10 (sheet franka-fci, section 1)."""
