"""A person who closes and opens the hand again and again, never twice quite the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from runtime.signals import Array
from sim.hand import RANGES
from sim.wearer.motion import minimum_jerk

_OPEN: Final[Array] = np.deg2rad(
    [[10, 25, 0, 0], [8, 5, 8, 5], [0, 5, 8, 5], [-6, 5, 8, 5], [-12, 5, 8, 5]]  # spread a little
)
_CLOSED: Final[Array] = np.deg2rad(
    [[-45, 80, 0, 10], [2, 55, 65, 43], [0, 60, 70, 46], [-1, 62, 72, 48], [-3, 64, 70, 46]]  # thumb opposed
)


@dataclass(frozen=True)
class _Grasp:
    start: Array  # (2, 5, 1) fraction of the period at which each finger sets off to close, and to open
    pace: Array  # (2, 5, 1) 1 / (fraction of the period the movement takes)
    way: Array  # (5, 4) rad, from the open to the closed posture


class ScriptedWearer:
    """Grasps of minimum-jerk timing; fingers set off and arrive at different instants.

    Within a period the hand rests open, closes (about a quarter of the period), holds, and opens. How far and
    how fast is drawn for each grasp from the seed and the grasp's number alone.
    """

    duration = float("inf")

    def __init__(self, seed: int, *, period: float = 4.0, speed: float = 1.0) -> None:
        """Args: period, s, from one grasp to the next, at speed 1."""
        self._seed, self._period = seed, period / speed
        self._number, self._grasp = -1, self._draw(0)

    def target(self, t: float) -> Array:
        number, s = divmod(max(t, 0.0) / self._period, 1.0)
        if int(number) != self._number:
            self._number, self._grasp = int(number), self._draw(int(number))
        g = self._grasp
        closed, opened = minimum_jerk((s - g.start) * g.pace)
        return (_OPEN + (closed - opened) * g.way).ravel()

    def _draw(self, number: int) -> _Grasp:
        rng = np.random.default_rng([self._seed, number])

        def per_finger(low: float, high: float) -> Array:
            return rng.uniform(low, high, (5, 1))

        reach = rng.uniform(0.65, 1.0) * per_finger(0.92, 1.0)
        lower, upper = RANGES.T.reshape(2, 5, 4)
        posture = np.clip(_OPEN + reach * (_CLOSED - _OPEN), lower, upper)
        return _Grasp(
            start=np.stack([per_finger(0.10, 0.16), per_finger(0.60, 0.66)]),
            pace=1.0 / np.stack([per_finger(0.20, 0.30), per_finger(0.20, 0.30)]),
            way=posture - _OPEN,
        )
