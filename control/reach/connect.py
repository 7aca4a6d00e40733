"""RRT-Connect in steps of a bounded size, whose every edge is judged at once.

Two trees grow from the start and the goal towards random points and each other, until they meet. Here one `grow` is one
turn of it: a branch of the one tree towards a random point, as far as it is free and at most `BRANCH`, and a branch of
the other tree towards the end of that one, as far as it is free. So a cycle's price is known, and a seed gives the same
path again.

Source: Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, ICRA 2000.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

BRANCH: Final = 1.0  # of the scaled space, towards a random point
SPACING: Final = 0.08  # of the scaled space, between two points that are judged
Free = Callable[[Array], NDArray[np.bool_]]


def along(a: Array, b: Array) -> Array:
    """(m, n): points from a to b, each within SPACING of the next, a left out; scaled."""
    m = max(int(np.ceil(float(np.abs(b - a).max()) / SPACING)), 1)
    made: Array = a + (np.arange(1, m + 1) / m)[:, None] * (b - a)
    return made


class _Tree:
    def __init__(self, root: Array) -> None:
        self.nodes, self.parents = [root], [-1]

    def nearest(self, point: Array) -> int:
        return int(np.abs(np.array(self.nodes) - point).max(axis=1).argmin())

    def branch(self, point: Array, most: float, free: Free) -> tuple[int, bool]:
        """A new node towards `point`: its index, and whether it is there. The nearest one where nothing is free."""
        at = self.nearest(point)
        start = self.nodes[at]
        far = float(np.abs(point - start).max())
        if far < 1e-9:
            return at, True
        end = point if far <= most else start + (point - start) * (most / far)
        points = along(start, end)
        bad = np.flatnonzero(~free(points))
        count = len(points) if not bad.size else int(bad[0])
        if count == 0:
            return at, False
        self.nodes.append(points[count - 1])
        self.parents.append(at)
        return len(self.nodes) - 1, count == len(points) and far <= most

    def back(self, at: int) -> list[Array]:
        """The nodes from this one to the root."""
        found = []
        while at >= 0:
            found.append(self.nodes[at])
            at = self.parents[at]
        return found


class Connect:
    """One search; see the module's text.

    Attributes:
        iterations: how often it has grown.
    """

    def __init__(self, start: Array, goal: Array, lower: Array, upper: Array, free: Free, seed: int) -> None:
        """
        Args:
            start, goal: (n,), scaled so that all elements go at 1 a second.
            lower, upper: (n,) of the random points.
            free: whether the arm may be at points (m, n).
            seed: of the random points.
        """
        self._trees, self._from_start = [_Tree(start), _Tree(goal)], True
        self._low, self._high, self._free = lower, upper, free
        self._rng = np.random.default_rng(seed)
        self.iterations = 0

    def grow(self) -> Array | None:
        """One turn; the path (k, n) from start to goal once there is one."""
        a, b = self._trees
        self.iterations += 1
        new, _ = a.branch(self._rng.uniform(self._low, self._high), BRANCH, self._free)
        met, there = b.branch(a.nodes[new], np.inf, self._free)
        path = a.back(new)[::-1] + b.back(met)[1:] if there else None
        if path is not None and not self._from_start:
            path = path[::-1]
        self._trees, self._from_start = [b, a], not self._from_start
        return None if path is None else np.array(path)
