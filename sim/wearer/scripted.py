"""A wearer that repeatedly closes and opens the hand, with variations between grasps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import RANGES
from srl.sim.wearer.fitting import Fitted
from srl.sim.wearer.motion import quintic

_OPEN: Final[Array] = np.deg2rad(
    [[10, 25, 0, 0], [8, 5, 8, 5], [0, 5, 8, 5], [-6, 5, 8, 5], [-12, 5, 8, 5]]  # spread a little
)
_CLOSED: Final[Array] = np.deg2rad(
    [[-45, 80, 0, 10], [2, 55, 65, 43], [0, 60, 70, 46], [-1, 62, 72, 48], [-3, 64, 70, 46]]  # thumb opposed
)


@dataclass(frozen=True)
class _Grasp:
    # For each finger, for closing and then for opening: the fraction of the period at which it starts, and
    # 1 / (the fraction that the movement takes).
    timing: list[list[float]]
    joints: list[list[list[float]]]  # for each finger's joints: rad when open, and the change from there to closed


class ScriptedWearer:
    """Grasps with minimum-jerk timing; fingers start and arrive at different times.

    In each period the hand rests open, closes (about a quarter of the period), holds, and opens. The extent and speed
    of each grasp are drawn from the seed and the grasp's number only.
    """

    duration = float("inf")
    fitted: Fitted | None = None

    def __init__(self, seed: int, *, ranges: Array = RANGES, period: float = 4.0, speed: float = 1.0) -> None:
        """Args: ranges (20, 2), rad, of the joints; period, s, from one grasp to the next, at speed 1."""
        limits = ranges.T.reshape(2, 5, 4)
        self._open, self._limits = np.clip(_OPEN, *limits), limits
        self._seed, self._period = seed, period / speed
        self._number, self._grasp = -1, self._draw(0)

    def target(self, t: float) -> Array:
        number, s = divmod(max(t, 0.0) / self._period, 1.0)
        if int(number) != self._number:
            self._number, self._grasp = int(number), self._draw(int(number))
        g = self._grasp
        # For so few numbers, plain Python is faster than arrays. All fingers have closed (at 0.46 of the period
        # or before) when the first one opens (at 0.6 or later).
        target: list[float] = []
        for (close, pace, reopen, back), joints in zip(g.timing, g.joints, strict=True):
            closed = _moved(s - close, pace) if s < reopen else 1.0 - _moved(s - reopen, back)
            target += [opened + closed * way for opened, way in joints]
        return np.array(target)

    def _draw(self, number: int) -> _Grasp:
        rng = np.random.default_rng([self._seed, number])

        def per_finger(low: float, high: float) -> Array:
            return rng.uniform(low, high, (5, 1))

        reach = rng.uniform(0.65, 1.0) * per_finger(0.92, 1.0)
        posture = np.clip(self._open + reach * (_CLOSED - self._open), *self._limits)
        close, reopen = per_finger(0.10, 0.16), per_finger(0.60, 0.66)
        pace, back = 1.0 / per_finger(0.20, 0.30), 1.0 / per_finger(0.20, 0.30)
        joints = np.stack([self._open, posture - self._open], axis=-1)
        return _Grasp(np.hstack([close, pace, reopen, back]).tolist(), joints.tolist())


def _moved(s: float, pace: float) -> float:
    s *= pace
    return 0.0 if s <= 0.0 else 1.0 if s >= 1.0 else quintic(s)
