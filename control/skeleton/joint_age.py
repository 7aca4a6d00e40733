"""Which segments of a body are known at present: one sensor of a suit may hang while the others go on."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.contracts.signals import Array

MOVES: Final = 10  # samples in which a joint must have changed before it is one that moves
LATEST: Final = np.iinfo(np.int64).max


class JointAge:
    """Follows when each joint's rotation changed last.

    A segment is as old as the oldest of the joints that move it, as it is seen from the node that carries the arms. A
    joint whose rotation never changes counts for none: a suit without gloves sends fingers that stand still for good.
    Nobody can tell such a joint from one that hung from the beginning.

    Attributes:
        fresh: (s,) whether the segment's joints have changed, as long as a velocity is a mean.
        moved: (s,) whether they have all changed in the newest sample: a repeated one says nothing of a velocity.
        oldest: (s,) ns, the oldest last change of the joints that move the segment.
    """

    def __init__(self, figure: HumanSrl, ends: NDArray[np.intp], repeat: float) -> None:
        """
        Args:
            figure: the skeleton.
            ends: (s, 2) indices of nodes in its tree.
            repeat: s for which a rotation that repeats itself in every bit is taken for new.
        """
        self.names = figure.labels
        self._by = np.array([_moved_by(figure, two.tolist()) for two in ends])  # (s, k)
        self._repeat = round(repeat * 1e9)
        k = len(self.names)
        self._last: Array | None = None
        self._changes = np.zeros(k, np.int64)
        self._changed = np.zeros(k, np.int64)  # ns
        self._broken = np.full(k, -1, np.int64)  # ns, when it wasn't new last
        self.fresh: NDArray[np.bool_] = np.zeros(len(ends), np.bool_)
        self.moved: NDArray[np.bool_] = np.zeros(len(ends), np.bool_)
        self.oldest = np.full(len(ends), LATEST)

    def take(self, stamp: int, rotation: Array, first: int) -> None:
        """Takes a sample.

        Args:
            stamp: ns.
            rotation: (k, 4) w x y z, of the human's joints.
            first: ns, stamp of the sample from which velocities are means.
        """
        changed: NDArray[np.bool_] = np.ones(len(rotation), np.bool_)
        if self._last is not None:
            changed = np.any(rotation != self._last, axis=1)
        self._changes += changed if self._last is not None else 0
        self._last = rotation.copy()
        self._changed[changed] = stamp
        self._broken[stamp - self._changed > self._repeat] = stamp
        counts = self._by & (self._changes >= MOVES)
        self.fresh = ~np.any(counts & (self._broken >= first), axis=1)
        self.moved = ~np.any(counts & ~changed, axis=1)
        self.oldest = np.where(counts, self._changed, LATEST).min(axis=1)

    def name(self, segment: int) -> str:
        """The joint that makes a segment old."""
        counts = self._by[segment] & (self._changes >= MOVES)
        return self.names[int(np.where(counts, self._changed, LATEST).argmin())]


def _moved_by(figure: HumanSrl, ends: list[int]) -> NDArray[np.bool_]:
    """(k,): whether a joint's rotation moves one of these nodes in the frame of the node that carries the arms."""
    tree = figure.tree

    def above(node: int) -> list[int]:
        made = [node]
        while tree.parents[made[-1]] >= 0:
            made.append(tree.parents[made[-1]])
        return made

    carrier, turns = above(tree.index(figure.arms.parent)), set[int]()
    for end in ends:
        # A rotation moves what is behind its own node: of the end itself it moves nothing.
        way = above(end)
        turns |= set(way[1:]).symmetric_difference(carrier) - (set(way) & set(carrier))
    return np.isin(figure.joints, sorted(turns))
