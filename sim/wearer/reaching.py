"""A standing person who reaches for things with one arm after the other: what is added to the posture at ease."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS
from srl.runtime.contracts.signals import Array
from srl.sim.wearer.motion import minimum_jerk

_MOVE, _REST = 1.2, 0.6  # s of a reaching movement, s of rest before the next


class Reaching:
    """Angles as a function of time only: the same time gives the same bits, in any order."""

    def __init__(self, key: Sequence[int], index: Mapping[str, int]) -> None:
        """
        Args:
            key: of the places that are drawn.
            index: of each joint by name.
        """
        self._key, self._index = key, index
        self._goals: dict[int, Array] = {}

    def at(self, t: float) -> Array:
        """(59, 3) degrees at t s, from 0 on."""
        number = int(t // (_MOVE + _REST))
        share = minimum_jerk(np.array((t - number * (_MOVE + _REST)) / _MOVE))
        start, goal = self._goal(number - 1), self._goal(number)
        return start + share * (goal - start)

    def _goal(self, number: int) -> Array:
        """Degrees at the end of movement `number`."""
        if number in self._goals:
            return self._goals[number]
        angles = np.zeros((JOINTS, 3))
        if number < 0:
            return angles
        rng = np.random.default_rng([*self._key, number])
        side, sign = (("Right", -1.0), ("Left", 1.0))[number % 2]
        forward, up, elbow = rng.uniform([40.0, 30.0, 0.0], [85.0, 80.0, 60.0])
        angles[self._index[f"{side}Arm"]] = -sign * forward, 0.0, sign * up
        angles[self._index[f"{side}ForeArm"], 0] = -sign * elbow
        angles[self._index[f"{side}Hand"]] = rng.uniform(-20.0, 20.0, 3)
        angles[self._index["Spine"], :2] = -sign * rng.uniform(0.0, 15.0), rng.uniform(0.0, 12.0)
        angles[self._index["Head"], :2] = -sign * rng.uniform(0.0, 20.0), rng.uniform(0.0, 15.0)
        if len(self._goals) > 4:
            self._goals.clear()
        self._goals[number] = angles
        return angles
