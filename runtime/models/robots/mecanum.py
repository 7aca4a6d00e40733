"""A base on four mecanum wheels, and Robotnik's SUMMIT-XL STEEL (sheet summit_xl_steel).

Body frame: x forward, y left, origin at the height of the wheels' axles. Order of the wheels: front left, front
right, back left, back right. Seen from above, the rollers' axes point to the middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True)
class MecanumBase:
    """An omnidirectional base.

    Attributes:
        mass: kg.
        inertia: kg m^2 about the vertical axis through its middle.
        wheel_radius: m.
        half_length, half_width: m, from the middle to the wheels' centres.
        size: m, length, width and height of the contact box.
        clearance: m, from the ground to the box.
        wheel_speed: rad/s, the greatest.
        v_max, w_max: m/s, rad/s, the greatest that the wheels allow along one axis alone.
        v_guard, w_guard, a_guard, dw_guard: forward and sideways m/s, rad/s, m/s^2, rad/s^2: the values that the
            maker's own planner commands; sensible near people.
        payload: kg.
    """

    name: str
    mass: float
    inertia: float
    wheel_radius: float
    half_length: float
    half_width: float
    size: tuple[float, float, float]
    clearance: float
    v_max: float
    v_guard: tuple[float, float]
    w_guard: float
    a_guard: float
    dw_guard: float
    payload: float

    @property
    def wheel_speed(self) -> float:
        return self.v_max / self.wheel_radius

    @property
    def lever(self) -> float:
        """m, half length plus half width: a wheel's rolling speed for each rad/s of rotation."""
        return self.half_length + self.half_width

    @property
    def w_max(self) -> float:
        return self.v_max / self.lever

    # Four numbers in an array take ten times as long.
    def wheels(self, vx: float, vy: float, wz: float) -> tuple[float, float, float, float]:
        """Wheel speeds, rad/s, for a twist (m/s, m/s, rad/s) of the body."""
        turn, r = self.lever * wz, self.wheel_radius
        return (vx - vy - turn) / r, (vx + vy + turn) / r, (vx + vy - turn) / r, (vx - vy + turn) / r

    def twist(self, fl: float, fr: float, bl: float, br: float) -> tuple[float, float, float]:
        """The twist vx, vy, wz (m/s, m/s, rad/s) that best fits wheel speeds, rad/s."""
        part = self.wheel_radius / 4
        return part * (fl + fr + bl + br), part * (-fl + fr + bl - br), part * ((-fl + fr - bl + br) / self.lever)


SUMMIT_XL: Final = MecanumBase(
    name="summit-xl",
    mass=105.0,
    inertia=7.4527,  # a box of that mass; the paper's 21 kg m^2 is a virtual inertia
    wheel_radius=0.127,
    half_length=0.2225,
    half_width=0.2045,
    size=(0.75, 0.68, 0.443),
    clearance=0.066,
    v_max=3.0,
    v_guard=(0.75, 0.5),
    w_guard=0.785,
    a_guard=0.2,
    dw_guard=0.2,
    payload=250.0,
)
