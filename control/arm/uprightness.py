"""Which way is up in an arm's base: measured by an inertial sensor on it, or said by the tree of frames."""

from __future__ import annotations

from math import acos, cos, degrees, inf, isfinite, pi, sin
from typing import Final

import numpy as np

from srl.control.shared.turns import measured_turn
from srl.runtime.contracts.rotation import Vector, conjugate, product, turned
from srl.runtime.contracts.signals import Array

_UP: Final[Vector] = (0.0, 0.0, 1.0)  # of an inertial sensor's reference, and of a world frame
_LYING: Final = pi / 2  # rad
_OFF: Final = 0.1  # by which a quaternion's length may be off 1


class Uprightness:
    """Up, followed by a low-pass; what isn't measured leaves it as it was.

    Farther from where it is while the wearer stands than a limit, up is rather measured wrong than true: a sensor
    mounted otherwise than its frame says, or one that has come off. Before it has once been within the limit it isn't
    believed at all. Later it may be a wearer who lies down, so it is followed to the horizontal or the limit, whichever
    is farther: an arm must not sink then. Farther, it is cut to that: no weight is held upside down.

    Attributes:
        up: (3,) unit vector in the base's axes.
        missing: s, for which it hasn't been measured; inf: never since the reset.
        beyond: s, for which it has been beyond the limit; inf: since the reset.
    """

    def __init__(self, smooth: float, standing: Vector, limit: float) -> None:
        """Args:
        smooth: s, time constant of the low-pass.
        standing: up where the wearer stands, a unit vector.
        limit: rad.
        """
        self._smooth, self._limit, self._farthest = smooth, limit, max(limit, _LYING)
        self._standing = np.array(standing)
        self.up: Array = self._standing.copy()
        self.missing = self.beyond = 0.0
        self._known = False  # it has been within the limit
        self._off = 0.0  # rad, as measured last

    def reset(self, found: Vector | None) -> None:
        """Takes what is measured now, as it is."""
        self.missing, self.beyond = (0.0 if found is not None else inf), 0.0
        if found is None:
            return
        if self._is_beyond(found):
            self.beyond = inf
        else:
            self.up, self._known = np.array(found), True

    def update(self, found: Vector | None, dt: float) -> None:
        """Goes on for dt seconds."""
        if found is None:
            self.missing += dt
            return
        first = not isfinite(self.missing) or not self._known  # nothing was compensated by what was before
        self.missing = 0.0
        new = np.array(found)
        if self._is_beyond(found):
            self.beyond += dt
            if not self._known:
                return
            if self._off > self._farthest:
                new = self._cut(new)
        else:
            self.beyond, self._known = 0.0, True
        if first:
            self.up = new
        mixed = self.up + dt / (dt + self._smooth) * (new - self.up)
        length = float(np.linalg.norm(mixed))
        if length > 1e-6:  # else it is upside down within one cycle: not believed
            self.up = mixed / length

    def why(self, source: str) -> str:
        """What is probably wrong where it is `beyond`; `source`: what says where up is."""
        standing = ", ".join(f"{value:.3g}" for value in self._standing)
        return (
            f"{source} says that up is {degrees(self._off):.0f} degrees from ({standing}) in the arm's base, and a "
            f"worn base leans by {degrees(self._limit):.0f} at most ('tilt_limit'). Stand upright; if it says so "
            "still, mount the sensor as `frames:` says, or correct its frame there"
        )

    def _is_beyond(self, found: Vector) -> bool:
        self._off = acos(min(max(float(self._standing @ found), -1.0), 1.0))
        return self._off > self._limit

    def _cut(self, found: Array) -> Array:
        """The direction nearest to `found` that may be followed; upside down has none: where up was."""
        aside = found - (self._standing @ found) * self._standing
        length = float(np.linalg.norm(aside))
        if length < 1e-6:
            return self.up
        made: Array = cos(self._farthest) * self._standing + sin(self._farthest) / length * aside
        return made


def by_sensor(orientation: Array, mount: Array) -> Vector | None:
    """Up in the base. None: it isn't measured.

    Args:
        orientation: (4,) w x y z of the sensor in its own upright reference.
        mount: (7,) the sensor's pose in the base.
    """
    sensor, placed = measured_turn(orientation.tolist()), measured_turn(mount[3:].tolist())
    if sensor is None or placed is None:
        return None
    return turned(product(placed, conjugate(sensor)), _UP)


def by_frames(base: Array) -> Vector | None:
    """Up in the base, whose pose (7,) in an upright frame is given. None: it isn't known."""
    turn = measured_turn(base[3:].tolist())
    return None if turn is None else turned(conjugate(turn), _UP)
