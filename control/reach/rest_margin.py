"""How much room an arm would have from the body, were it at rest in a posture."""

from __future__ import annotations

from math import isinf

import numpy as np

from srl.control.reach.options import MarginOptions
from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import jacobian, link_nodes, posture
from srl.runtime.contracts.signals import Array

_OTHER = 0.03  # m more from the other arm, which stops a little later than it is seen


class RestMargin:
    """The body as it was seen last, and how near it may come until an arm that hardly moves has stopped.

    The other arm is taken as it stands; where it goes is its guard's business, and both guards'.

    It is (1) of `srl.control.shared.approach` for one instant, `horizon` from now. The guard's clearance judges
    motions, more closely; this says where it is worth going.
    """

    def __init__(self, options: MarginOptions) -> None:
        self._options, self._arms, self._side = options, options.arms.arms, options.arm
        envelope = options.envelope
        self._links = np.array([pair.link for pair in envelope.pairs])
        self._segments = np.array([pair.segment for pair in envelope.pairs])
        self._radii = envelope.radii[self._segments] + envelope.link_radius
        self._a_e = options.body_acceleration * envelope.acceleration[self._segments].T
        self._body = BodyMotion(options.figure, envelope.ends, options.span)
        self._now, self._last = 0, b""
        self._needed = options.least + options.uncertainty + options.beside[self._links]
        # The other arm, as it is: its links, each with all links of this one that joints move.
        n = self._arms.n
        self._its, self._mine = np.tile(np.arange(n + 1), n), np.repeat(np.arange(1, n + 1), n + 1)
        self._other: Array | None = None  # (n + 1, 2, 3) m, ends of its links
        self._apart = (
            2.0 * envelope.link_radius
            + options.least
            + 2.0 * (options.uncertainty + float(options.beside.max()))
            + _OTHER
        )

    @property
    def known(self) -> bool:
        """Whether the body was seen long enough for its speeds."""
        return not isinf(self._body.window)

    def see_other(self, q: Array) -> None:
        """Takes where the other arm is, (n,) rad or m."""
        side = next(each for each in self._arms.sides if each != self._side)
        nodes = link_nodes(self._arms, side, q[None])[0]
        self._other = np.stack([nodes[:-1], nodes[1:]], axis=1)

    def forget(self) -> None:
        """The body wasn't seen for a while."""
        self._body.forget()
        self._last = b""

    def see(self, rotation: Array, translation: Array, dt: float) -> None:
        """Takes what the suit says, dt s after the time before. A pose that is none is left out."""
        self._now += round(dt * 1e9)
        values = rotation.tobytes() + translation.tobytes()
        if values != self._last and not self._body.trouble(rotation, translation):
            self._last = values
            self._body.take(self._now, rotation, translation)

    def margins(self, path: Array) -> Array:
        """(m,) m: what each posture (m, n), rad or m, keeps more than is needed, of the worst pair. Below 0: less."""
        return self._margins(posture(self._arms, self._side, path)[0])[0].min(axis=1)

    def outward(self, q: Array, share: float) -> Array:
        """(n,) m for each rad or m: the way out of what is too near, the worse the more.

        Args:
            q: (n,) rad or m.
            share: m, of margin below which a pair counts.
        """
        nodes, axes = posture(self._arms, self._side, q[None])
        margin, normal, on_link = self._margins(nodes)
        near = np.flatnonzero(margin[0] < share)
        J = jacobian(self._arms, nodes, axes)[:, 0]
        every = self._links if self._other is None else np.concatenate([self._links, self._mine])
        links, t = every[near], on_link[0, near, None]
        columns = (1.0 - t) * J[:, links] + t * J[:, links + 1]
        rows = np.add.reduce(normal[:, 0, near, None] * columns, axis=0)
        way: Array = (share - margin[0, near]) @ rows
        return way

    def _margins(self, nodes: Array) -> tuple[Array, Array, Array]:
        """(m, k) m; the normals (3, m, k), and where on the links they are, (m, k)."""
        body, t = self._body, self._options.horizon
        found = nearest(body.ends, self._segments, nodes, self._links)
        distance = found.distance - self._radii
        velocity = body.velocity.transpose(1, 2, 0).take(self._segments, axis=2)[:, :, None]
        swing = 0.0 if isinf(body.window) else body.window / 2
        gone = np.maximum(np.add.reduce(velocity * found.normal, axis=1), 0.0) * t
        gone += (self._a_e * (swing * t + 0.5 * t * t))[:, None] + self._options.noise * t / self._options.span
        first = distance + found.on_segment * found.along
        margin = np.minimum(first - gone[0], first - found.along - gone[1]) - self._needed
        if self._other is None:
            return margin, found.normal, found.on_link
        other = nearest(self._other, self._its, nodes, self._mine)
        return (
            np.concatenate([margin, other.distance - self._apart], axis=-1),
            np.concatenate([found.normal, other.normal], axis=-1),
            np.concatenate([found.on_link, other.on_link], axis=-1),
        )
