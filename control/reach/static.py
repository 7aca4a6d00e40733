"""A way round what stands: RRT-Connect, made shorter, and then judged closely by conservative advancement.

Where the margin is m and no point of the arm moves farther than r for each unit of the way, the next m / r of it are
free. So an edge is judged at few places where there is room, and at none twice. Where less than `FLOOR` is left, the
step is that of `FLOOR`: between two places the margin is then at most half of it below zero. That takes many looks near
things, so the trees grow by steps of `COARSE`, and only the way that they found is judged closely. If it isn't free,
the search begins anew.

The search asks for one posture after the other, so that a cycle looks at as many as it has time for.

Source: Kuffner and LaValle, ICRA 2000 (RRT-Connect); Mirtich, Impulse-based dynamic simulation of rigid body systems,
1996 (conservative advancement).
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from itertools import pairwise
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

FLOOR: Final = 0.005  # m
COARSE: Final = 0.1  # of the scaled space
_BRANCH: Final = 1.0  # of the scaled space, towards a random point
_SHORTER: Final = 10  # attempts to make the way shorter
_Tree = list[tuple[Array, int]]  # nodes, each with the place of the one before it; the root's is -1
Search = Generator[Array, float, list[Array]]  # asks for the margin, m, of a posture; returns the way


class Way:
    """The search for one way; postures are scaled: all elements go at 1 a second.

    Attributes:
        start: (n,).
        looked: number of postures that were judged.
    """

    def __init__(self, start: Array, goal: Array, lower: Array, upper: Array, levers: Array, seed: int) -> None:
        """
        Args:
            start, goal: (n,).
            lower, upper: (n,) of the random points.
            levers: (n,) m that the farthest point moves for 1 of each element.
            seed: of the random points.
        """
        self.start, self._goal, self._low, self._high, self._levers = start, goal, lower, upper, levers
        self._rng = np.random.default_rng(seed)
        self._run = self._search()
        self._asked: Array | None = None
        self.looked = 0

    def look(self, margin: Callable[[Array], float], most: int) -> list[Array] | None:
        """Judges up to `most` postures. Returns the way (start and goal included) once there is one."""
        try:
            for _ in range(most):
                if self._asked is None:
                    self._asked = next(self._run)
                self.looked += 1
                self._asked = self._run.send(margin(self._asked))
        except StopIteration as end:
            found: list[Array] = end.value
            return found
        return None

    def _search(self) -> Search:
        way: list[Array] = [self.start, self._goal]
        while True:
            for a, b in pairwise(way):
                if not (yield from self._edge(a, b, COARSE))[1]:
                    break
            else:
                for a, b in pairwise(way):
                    if not (yield from self._edge(a, b, 0.0))[1]:
                        break
                else:
                    return way
            way = yield from self._connect()

    def _connect(self) -> Generator[Array, float, list[Array]]:
        trees: list[_Tree] = [[(self.start, -1)], [(self._goal, -1)]]
        first = 0
        while True:
            a, b = trees[first], trees[1 - first]
            aim = self._rng.uniform(self._low, self._high)
            new, _ = yield from self._grow(a, aim, _BRANCH)
            met, there = yield from self._grow(b, a[new][0], np.inf)
            if there:
                own, other = _back(a, new)[::-1], _back(b, met)[1:]
                way = own + other if first == 0 else (own + other)[::-1]
                return (yield from self._shorter(way))
            first = 1 - first

    def _grow(
        self, tree: list[tuple[Array, int]], aim: Array, most: float
    ) -> Generator[Array, float, tuple[int, bool]]:
        """A branch towards `aim`: the index of its end, and whether that is there."""
        at = int(np.abs(np.array([node for node, _ in tree]) - aim).max(axis=1).argmin())
        start = tree[at][0]
        far = float(np.abs(aim - start).max())
        if far < 1e-9:
            return at, True
        end = aim if far <= most else start + (aim - start) * (most / far)
        reached, free = yield from self._edge(start, end, COARSE)
        if float(np.abs(reached - start).max()) < 1e-6:
            return at, False
        tree.append((reached, at))
        return len(tree) - 1, free and far <= most

    def _edge(self, start: Array, end: Array, coarse: float) -> Generator[Array, float, tuple[Array, bool]]:
        """The last free place on the way from start to end, and whether that is the end. The start is free.

        coarse: length of a step that is taken whatever the margin.
        """
        if not (end != start).any():
            return end, True
        rate = max(float(np.abs(end - start) @ self._levers), 1e-12)  # what nothing hangs on is looked at once
        least = max(FLOOR / rate, coarse / float(np.abs(end - start).max()))
        last, t = start, min(least, 1.0)
        while True:
            here = start + t * (end - start)
            margin = yield here
            if not margin >= 0.0:
                return last, False
            if t >= 1.0:
                return end, True
            last, t = here, min(t + max(margin / rate, least), 1.0)

    def _shorter(self, way: list[Array]) -> Generator[Array, float, list[Array]]:
        """Straight where that is free between two drawn places of the way."""
        for _ in range(_SHORTER):
            if len(way) < 3:
                break
            i, j = sorted(self._rng.choice(len(way), 2, replace=False).tolist())
            if j - i < 2:
                continue
            if (yield from self._edge(way[i], way[j], COARSE))[1]:
                way = way[: i + 1] + way[j:]
        return way


def _back(tree: _Tree, at: int) -> list[Array]:
    found = []
    while at >= 0:
        found.append(tree[at][0])
        at = tree[at][1]
    return found
