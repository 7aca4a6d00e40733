"""The other arm of a wearer, as it is seen by an arm that must keep clear of it.

It moves, too, but not freely: its own guard lets it go only on motions to rest that were accepted. So it stays within
its `extent` (`srl.runtime.contracts.clearance`): what it was commanded within its lag, the whole motion that was
accepted last, and by how much it may be beside that. A motion of this arm that keeps clear of all of that is clear
whenever either of them brakes. The two are judged one after the other, each against what the other was allowed last: of
any two places that they may be in at once, the one that was allowed later was compared with the other.

Let m be the middle of the extent and h half of its size. No point of link j is farther than r_j = sum_i R_ij h_i from
where it is at m (R as in `srl.control.skeleton.envelope.reaches`), so the link at m, thicker by r_j, holds
all of it. A link of this arm that is too near may leave it as it may leave a body that moves by r_j
(`srl.control.shared.leaving`). Of two arms that both leave, neither closes the distance by its own motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from srl.control.shared.approach import Separation
from srl.control.skeleton.capsules import Nearest, nearest
from srl.control.skeleton.envelope import link_nodes
from srl.control.skeleton.levers import Way
from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Arms, Side


@dataclass(frozen=True)
class Limb:
    """An arm as its clearance knows it.

    Attributes:
        arms, side: which.
        order: (n,) from the command's order to the arm's.
        reach: (n, n + 1) m for each rad or m, of `envelope.reaches`.
        links: the links' names, n + 1.
        radius: m, of its links.
        uncertainty: m, Z_d: by which its base may be beside where it is said to be.
    """

    arms: Arms
    side: Side
    order: NDArray[np.intp]
    reach: Array
    links: tuple[str, ...]
    radius: float
    uncertainty: float


class Judged(NamedTuple):
    """The pairs of links (own, other), row by row.

    Attributes:
        margin: (m - 1, k) m, as `srl.control.shared.approach.margins`; of one piece where a quick look was enough.
        distance: (m, k) m, from the middle of the other arm's extent.
        closing: (k,) m/s, by which the own motion may close it at most; where the margin is negative.
    """

    margin: Array
    distance: Array
    closing: Array


class OtherArm:
    """Compares an arm with another one; see the module's text."""

    def __init__(self, own: Limb, other: Limb, clearance: Clearance, least: float) -> None:
        """
        Args:
            own, other: the arms; their bases hang on one node.
            clearance: the other's, whose `extent` is read.
            least: m, C.
        """
        self._own, self._other, self._clearance = own, other, clearance
        n, m = len(own.links), len(other.links)
        self._mine = np.repeat(np.arange(1, n), m)  # no joint moves the link at the base
        self._its = np.tile(np.arange(m), n - 1)
        self._radii = own.radius + other.radius
        self._least, self._beside_base = least, own.uncertainty + other.uncertainty
        self._needed = least + self._beside_base
        self._seen: tuple[Array, Array] | None = None
        self._nodes, self._spread = np.zeros((m + 1, 3)), np.zeros(m)

    def __len__(self) -> int:
        return len(self._mine)

    @property
    def place(self) -> str:
        """Of the other arm's clearance in the profile."""
        return self._clearance.place

    def name(self, pair: int) -> str:
        """What the pair is called."""
        return f"{self._own.links[self._mine[pair]]}/{self._other.links[self._its[pair]]}"

    def judge(self, way: Way) -> Judged | None:
        """Judges a motion of the own arm; None if nobody knows where the other arm is."""
        extent = self._clearance.extent
        if extent is None:
            return None
        if extent is not self._seen:
            self._seen = extent
            low, high = (each[self._other.order] for each in extent)
            self._nodes = link_nodes(self._other.arms, self._other.side, (low + high)[None] / 2)[0]
            self._spread = (high - low) / 2 @ self._other.reach
        mine, beside = self._mine, self._spread[self._its]
        needed = self._needed + way.slack[mine] + beside
        first = self._nearest(way.nodes[:1], mine, self._its).distance - self._radii
        bound = first - way.travel.sum(axis=0)[mine] - needed
        limit = np.zeros(len(mine))
        if (bound >= 0.0).all():  # so far apart that the whole way wouldn't do
            return Judged(bound, first, limit)
        found = self._nearest(way.nodes, mine, self._its)
        distance = found.distance - self._radii
        margin = 0.5 * (distance[:-1] + distance[1:] - way.travel[:, mine]) - needed
        close = np.flatnonzero(~(margin >= 0.0).all(axis=0))
        if close.size:
            margin[:, close], limit[close] = self._close(way, found, close, margin[:, close])
        return Judged(margin, distance, limit)

    def _close(self, way: Way, found: Nearest, close: NDArray[np.intp], margin: Array) -> tuple[Array, Array]:
        """As `BodyClearance._close`: the other link doesn't go on with time, it is thicker."""
        found = Nearest(*(each.take(close, axis=-1) for each in found))
        links, beside = self._mine.take(close), self._spread[self._its.take(close)]
        levers = way.levers(found, links)
        height = (found.distance - self._radii - beside)[..., None]
        needed = Separation(0.0, self._least, self._beside_base)
        by_levers, gap = way.close(levers, height, np.zeros_like(height), links, 0.0, needed)
        margin = np.maximum(margin, by_levers)
        moved = np.broadcast_to(beside + self._beside_base, margin.shape)
        gap += self._radii
        return margin, way.closing(levers, links, gap, found.distance, moved, self._radii + self._least)

    def _nearest(self, nodes: Array, mine: NDArray[np.intp], its: NDArray[np.intp]) -> Nearest:
        """From the links at the middle of the other arm's extent, in all samples."""
        ends = np.stack([self._nodes[:-1], self._nodes[1:]], axis=1)
        return nearest(ends, its, nodes, mine)
