"""The exact step of M x_dd + D x_d = f for a force and a damping that stay constant over it (SUPER-MAN eq. 1).

    x_d(t + h) = x_d e^(-Dh/M) + f/D (1 - e^(-Dh/M)),      x(t + h) = x + the integral of x_d

It is stable for any h, mass and damping, and needs none (D = 0).
"""

from __future__ import annotations

from math import exp, expm1
from typing import Final

from srl.runtime.contracts import rotation

_SMALL: Final = 1e-2  # of D h / M, below which the series is used: (1 - phi) / x would lose digits


class VirtualMass:
    """A mass and an inertia on SO(3), each axis by itself.

    Translation is exact, and so is rotation about an axis that stays. Where the axis of rotation changes, the
    orientation is off by up to h^3/12 |w x w_d| a step: the angular velocity is integrated first, then its exponential
    is taken (Magnus, first term).

    Attributes:
        velocity: (6,) m/s and rad/s, world axes.
        position: (3,) m.
        orientation: unit quaternion.
    """

    def __init__(self) -> None:
        self._of: tuple[float, list[float], list[float]] = (0.0, [], [])
        self._factors: list[tuple[float, float, float, float]] = []
        self.reset((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))

    def reset(self, position: rotation.Vector, orientation: rotation.Quaternion) -> None:
        """At rest at this pose."""
        self.velocity = [0.0] * 6
        self.position, self.orientation = list(position), rotation.normalised(orientation)

    def step(self, h: float, mass: list[float], damping: list[float], force: list[float]) -> None:
        """Computes a step of h seconds.

        Args:
            mass: M (6,) kg and kg m^2.
            damping: D (6,) N s/m and N m s/rad, 0 or more.
            force: f (6,) N and N m, world axes.
        """
        if self._of != (h, mass, damping):
            self._of = (h, mass, damping)
            self._factors = [_factors(h, m, d) for m, d in zip(mass, damping, strict=True)]
        moved = [a * v + b * f for v, f, (_, _, a, b) in zip(self.velocity, force, self._factors, strict=True)]
        self.velocity = [a * v + b * f for v, f, (a, b, _, _) in zip(self.velocity, force, self._factors, strict=True)]
        x, y, z = self.position
        self.position = [x + moved[0], y + moved[1], z + moved[2]]
        turn = rotation.exp(moved[3], moved[4], moved[5])
        self.orientation = rotation.normalised(rotation.product(turn, self.orientation))

    def shift(self, by: rotation.Vector, turn: rotation.Vector) -> None:
        """Moves the pose by so many m, and turns it by a rotation vector, rad; world axes. The velocity stays."""
        (x, y, z), (dx, dy, dz) = self.position, by
        self.position = [x + dx, y + dy, z + dz]
        self.orientation = rotation.normalised(rotation.product(rotation.exp(*turn), self.orientation))

    def slow(self, h: float, mass: list[float], damping: list[float]) -> None:
        """Lets the velocity fade for h seconds; the pose stays."""
        self.velocity = [
            v * exp(-h * d / m) for v, m, d in zip(self.velocity, mass, damping, strict=True)
        ]  # fmt: skip


def _factors(h: float, m: float, d: float) -> tuple[float, float, float, float]:
    """What speed and force give to the next speed, and to the way made in a step."""
    x = h * d / m
    if x < _SMALL:
        # (1 - e^-x)/x and (x - 1 + e^-x)/x^2
        first = 1 - x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x / 720))))
        second = 1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040))))
    else:
        first = -expm1(-x) / x
        second = (1 - first) / x
    return exp(-x), h / m * first, h * first, h * h / m * second
