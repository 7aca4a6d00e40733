"""The other arm of a wearer, as it is seen by an arm that must keep clear of it.

It moves, too, but not freely: its own guard lets it go only on motions to rest that were accepted. So it stays within
its `extent` (`srl.runtime.contracts.clearance`): what it was commanded within its lag, the whole motion that was
accepted last, and by how much it may be beside that. A motion of this arm that keeps clear of all of that is clear
whenever either of them brakes. The two are judged one after the other, each against what the other was allowed last: of
any two places that they may be in at once, the one that was allowed later was compared with the other.

Let m be the middle of the extent and h half of its size. No point of link j is farther than r_j = sum_i R_ij h_i from
where it is at m (R as in `srl.control.skeleton.envelope.reaches`), so the link at m, thicker by r_j, holds
all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import link_nodes
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
        own: (k,) index of the own link.
    """

    margin: Array
    distance: Array
    own: NDArray[np.intp]


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
        self._needed = least + own.uncertainty + other.uncertainty
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

    def judge(self, nodes: Array, travel: Array, slack: Array) -> Judged | None:
        """Judges a motion; None if nobody knows where the other arm is.

        Args:
            nodes: (m, n + 2, 3) m, of the own arm, in samples.
            travel: (m - 1, n + 1) m, by link, between samples.
            slack: (n + 1,) m, by link.
        """
        extent = self._clearance.extent
        if extent is None:
            return None
        if extent is not self._seen:
            self._seen = extent
            low, high = (each[self._other.order] for each in extent)
            self._nodes = link_nodes(self._other.arms, self._other.side, (low + high)[None] / 2)[0]
            self._spread = (high - low) / 2 @ self._other.reach
        needed = self._needed + slack[self._mine] + self._spread[self._its]
        first = self._distance(nodes[:1])
        bound = first - travel.sum(axis=0)[self._mine] - needed
        if (bound >= 0.0).all():  # so far apart that the whole way wouldn't do
            return Judged(bound, first, self._mine)
        distance = self._distance(nodes)
        margin = 0.5 * (distance[:-1] + distance[1:] - travel[:, self._mine]) - needed
        return Judged(margin, distance, self._mine)

    def _distance(self, nodes: Array) -> Array:
        """(m, k) m, from the links at the middle of the other arm's extent."""
        ends = np.stack([self._nodes[:-1], self._nodes[1:]], axis=1)
        return nearest(ends, self._its, nodes, self._mine).distance - self._radii
