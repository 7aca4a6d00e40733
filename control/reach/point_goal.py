"""A worn arm's goal as a place of its end: a posture that puts it there and in which the arm could rest."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.reach.inverse import Inverse
from srl.control.reach.mode import Mode
from srl.control.reach.options import ReachConfig
from srl.control.reach.rest_margin import RestMargin
from srl.control.skeleton.envelope import jacobian, posture
from srl.runtime.contracts.signals import Array

_ENOUGH: Final = 6  # postures among which the nearest is taken
_TURNS: Final = 60  # after which one is enough
_GIVE_UP: Final = 250  # turns after which the place counts as unreachable, if no posture was found


class PointGoal:
    """Looks for postures, one turn of the search in a cycle.

    Attributes:
        mode: what it says while there is none.
    """

    def __init__(self, options: ReachConfig, place: Array, rest: RestMargin) -> None:
        """`place`: (3,) m, in the frame of the node that carries the arms."""
        self._options, self._place, self._rest = options, place, rest
        self._search: Inverse | None = None
        self._seed, self._reached, self._good = 0, False, list[Array]()
        self.mode = Mode.SEARCHING

    def look(self, q: Array) -> Array | None:
        """One turn, from posture q (n,) rad or m. Returns the nearest posture of those found, once they are enough."""
        ranges = self._options.ranges
        if self._search is None:
            self._seed += 1
            self._good.clear()
            self._search = Inverse(self._residual, ranges.q_lower, ranges.q_upper, q, self._seed)
        self._search.turn()
        found = self._search.take()
        if found:
            self._reached = True
            free = self._rest.margins(np.array(found)) >= 0.0
            self._good += [each for each, good in zip(found, free.tolist(), strict=True) if good]
        turns, count = self._search.turns, len(self._good)
        if count >= _ENOUGH or (count and turns >= _TURNS):
            self._search, self.mode = None, Mode.SEARCHING
            return min(self._good, key=lambda each: float(np.abs((each - q) / ranges.dq_max).max()))
        if turns >= _GIVE_UP:
            self._search, self.mode = None, Mode.WAITING if self._reached else Mode.UNREACHABLE
        return None

    def _residual(self, path: Array) -> tuple[Array, Array]:
        arms, side = self._options.arms.arms, self._options.arm
        nodes, axes = posture(arms, side, path)
        return self._place - nodes[:, -1], jacobian(arms, nodes, axes)[:, :, -1].transpose(1, 0, 2)
