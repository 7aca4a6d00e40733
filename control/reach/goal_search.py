"""Postures for a goal of the tool: they put it there, and they are free."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.reach.inverse import Inverse, Residual
from srl.control.reach.mode import Mode
from srl.control.skeleton.envelope import jacobian, posture
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Arms, Side

_ENOUGH: Final = 4  # postures among which the nearest is taken
_LONG: Final = 60  # iterations after which one is enough
_GIVE_UP: Final = 200  # iterations after which another search begins


class GoalSearch:
    """One iteration in a cycle, again and again from other starts.

    Attributes:
        mode: SEARCHING; after a search without a result WAITING, if no posture there was free, or UNREACHABLE.
    """

    def __init__(self, residual: Residual, free: Callable[[Array], NDArray[np.bool_]], speed: Array) -> None:
        """
        Args:
            residual: as `Inverse`.
            free: whether the arm may be in postures (m, n).
            speed: (n,) rad/s or m/s of each joint: the nearest posture is reached in the shortest time.
        """
        self._residual, self._free, self._speed = residual, free, speed
        self._search: Inverse | None = None
        self._seed, self._reached = 0, False
        self._found: list[Array] = []
        self.mode = Mode.SEARCHING

    def step(self, q: Array, lower: Array, upper: Array) -> list[Array]:
        """One iteration. Returns postures (n,) rad or m, the nearest first, once they are enough; else none.

        Args:
            q: (n,) rad or m, where the arm is.
            lower, upper: (n,) rad or m, of the joints.
        """
        if self._search is None:
            self._seed += 1
            self._found.clear()
            self._search = Inverse(self._residual, lower, upper, q, self._seed)
        there = self._search.step()
        if len(there):
            self._reached = True
            self._found += list(there[self._free(there)])
        iterations, count = self._search.iterations, len(self._found)
        if count >= _ENOUGH or (count and iterations >= _LONG):
            self._search, self.mode = None, Mode.SEARCHING
            return sorted(self._found, key=lambda found: float(np.abs((found - q) / self._speed).max()))
        if iterations >= _GIVE_UP:
            self._search, self.mode = None, Mode.WAITING if self._reached else Mode.UNREACHABLE
        return []


def search_of_point(
    arms: Arms, side: Side, place: Array, free: Callable[[Array], NDArray[np.bool_]], speed: Array
) -> GoalSearch:
    """For postures that put a worn arm's end at `place`, (3,) m in the frame of the node that carries the arms."""

    def residual(path: Array) -> tuple[Array, Array]:
        nodes, axes = posture(arms, side, path)
        return place - nodes[:, -1], jacobian(arms, nodes, axes)[:, :, -1].transpose(1, 0, 2)

    return GoalSearch(residual, free, speed)
