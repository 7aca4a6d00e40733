"""A motion of an arm, link by link: where its nodes are, and what each joint does to them in that posture."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from srl.control.shared.approach import Separation, by_levers, gaps, travels
from srl.control.shared.leaving import closing, contact_cone
from srl.control.skeleton.capsules import Nearest
from srl.control.skeleton.envelope import jacobian, posture
from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Arms, Side

Indices = NDArray[np.intp]


class Levers(NamedTuple):
    """Of k pairs in m samples.

    Attributes:
        normal: (3, m, k), n_j, from the other's nearest point to the link's.
        jacobian: (3, m, k, 2, n), J_f of the link's ends.
        above: (m, k, 2) m, h_jf.
        size: (m - 1, k, 2, n), |J_f|, the greater of both ends of each piece.
    """

    normal: Array
    jacobian: Array
    above: Array
    size: Array

    def take(self, which: Indices) -> Levers:
        """Those of these pairs."""
        return Levers(self.normal[:, :, which], self.jacobian[:, :, which], self.above[:, which], self.size[:, which])


class Way:
    """A braking motion in the arm's own order of joints.

    Attributes:
        path: (m, n) rad or m. nodes: (m, n + 2, 3) m. until: (m,) s.
        travel: (m - 1, n + 1) m, by link, between samples; slack: (n + 1,) m, by link: both by the farthest reach.
        speed: (n + 1,) m/s, that no point of the link exceeds.
    """

    def __init__(self, arms: Arms, side: Side, order: Indices, reach: Array, motion: Braking) -> None:
        """
        Args:
            arms, side: the arm.
            order: (n,) from the motion's order to the arm's.
            reach: (n, n + 1) m for each rad or m, of `envelope.reaches`.
            motion: in the command's order.
        """
        self._arms, self._side, self._order, self._reach = arms, side, order, reach
        self._turns = np.array([not joint.slides for joint in arms.joints])
        self._motion, self.until = motion, motion.until
        self.path = motion.path.take(order, axis=1)
        self.nodes, self._axes = posture(arms, side, self.path)
        self.travel = travels(self.path, reach)
        self._slack = motion.slack.take(order)
        self.slack = self._slack @ reach
        self.speed = motion.velocity.take(order) @ reach

    @cached_property
    def _jacobian(self) -> Array:
        return jacobian(self._arms, self.nodes, self._axes)

    def levers(self, found: Nearest, links: Indices) -> Levers:
        """What the joints do to the ends of these links.

        Args:
            found: their nearest points in all samples.
            links: (k,).
        """
        both = np.stack([links, links + 1], axis=1)
        a, b = (self.nodes.take(both[:, f], axis=1).transpose(2, 0, 1) for f in (0, 1))
        along = np.add.reduce(found.normal * (b - a), axis=0)
        above = np.stack([-found.on_link * along, (1.0 - found.on_link) * along], axis=-1)
        J = self._jacobian.take(both, axis=2)
        size = np.sqrt(np.add.reduce(J * J, axis=0))
        return Levers(found.normal, J, above, np.maximum(size[:-1], size[1:]))

    def close(
        self, levers: Levers, height: Array, speed: Array, links: Indices, age: float | Array, needed: Separation
    ) -> tuple[Array, Array]:
        """By the posture's own levers: the margins, and how near the arm and the other may come along the normal.

        Args:
            levers: of the pairs.
            links: (k,).
            height, speed, age, needed: as `srl.control.shared.approach.margins`.

        Returns:
            (m - 1, k) m each; the second as G of `srl.control.shared.leaving`, of the surfaces.
        """
        lever = np.add.reduce(levers.normal[..., None, None] * levers.jacobian, axis=0)
        change = self._change
        rho = self._bent(levers, links, change, change, third=3.0) / 2
        lowered = by_levers(lever, levers.above, self.path, self._slack, rho)
        before, after = gaps(height, speed, self.until, age, needed)
        margin = 0.5 * (before + after - lowered.travel) - (needed.least + needed.uncertainty + lowered.slack)
        return margin, before - needed.uncertainty - lowered.most

    def closing(
        self, levers: Levers, links: Indices, gap: Array, apart: Array, moved: Array, touching: Array | float
    ) -> Array:
        """By how much the arm's motion may close each distance, (k,) m/s; `srl.control.shared.leaving`.

        Args:
            levers: of the pairs.
            links: (k,).
            gap: G, (m - 1, k) m.
            apart: D, (m, k) m, of the axes.
            moved: (m - 1, k) m: by which the other may have moved until the limb has left each piece.
            touching: (k,) m, S.
        """
        most = self.speed.take(links)
        motion, change = self._motion, self._change
        if motion.rates is None:
            return most
        rates, spread = motion.rates.take(self._order, axis=1), motion.spread.take(self._order)
        own = (levers.size @ change[:, None, :, None])[..., 0].max(axis=-1)
        own += self._bent(levers, links, change, change, third=3.0) / 2
        cosine = contact_cone(gap, apart[:-1], moved + own, touching)
        stop = closing(levers.jacobian[:, :-1] @ rates[-1], levers.normal[:, :-1], cosine)
        found = (stop + self._bent(levers, links, change, np.abs(rates[-1]))).max(axis=0)
        for rate in rates[:-1]:
            first = closing(levers.jacobian[:, 0] @ rate, levers.normal[:, 0], cosine[0])
            found = np.maximum(found, first + self._bent(levers, links, change, np.abs(rate))[0])
        # Towards the end of the stop the rates vanish and the spread needn't.
        found = np.maximum(found, 0.0) + spread @ self._reach.take(links, axis=1)
        return np.minimum(found, most)

    @cached_property
    def _change(self) -> Array:
        """(m - 1, n) rad or m: |dq| + sigma."""
        changed: Array = np.abs(self.path[1:] - self.path[:-1]) + self._slack
        return changed

    def _bent(self, levers: Levers, links: Indices, u: Array, v: Array, third: float = 2.0) -> Array:
        """A bound of sum_ik |d2 x_f / dq_i dq_k| u_i v_k on each piece, (m - 1, k), for either end.

        Args:
            levers, links: of the pairs.
            u, v: (m - 1, n), or v (n,): at least 0.
            third: u has to be divided by this in the third order: 2 for a velocity v, 3 for a way v = u.
        """
        size = levers.size.max(axis=2)  # |J_fk| of the farther end, (m - 1, k, n)
        turns = self._turns
        v = np.broadcast_to(v, u.shape)
        # A pair of joints counts with the lever of the farther one, and not if the nearer one slides.
        before_u, before_v = (np.cumsum(each * turns, axis=1) - each * turns for each in (u, v))
        paired = u * before_v + v * before_u + u * v * turns
        R = np.maximum.accumulate(self._reach[::-1])[::-1].take(links, axis=1)  # (n, k): of this joint or a farther one
        return (size * paired[:, None]).sum(axis=-1) + (u.sum(axis=1) / third)[:, None] * (paired @ R)
