"""Postures by angles: where a search begins, and which of the angles that mean the same posture are taken."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, remainder
from typing import Final

import numpy as np

from srl.control.ikns.observability import Mask
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Side

# Postures (abduction, flexion, rotation, elbow) in degrees from which the posture is searched.
STARTS: Final = (
    (10, 0, 0, 60),
    (70, 0, 0, 90),
    (20, 60, 20, 40),
    (60, 40, 40, 100),
    (20, -20, 0, 100),
    (120, 0, 0, 30),
)
_SLACK: Final = np.deg2rad(20.0)  # angles that leave their ranges by less stay as they are
_REFUSED: Final = np.deg2rad(45.0)  # beyond its range; a wrist or forearm turned over is farther
_TURN: Final = 2 * np.pi


class Postures:
    """The angles of one body, against its joints' ranges.

    Whole turns of a joint mean the same posture. So do a shoulder's (a, b, c) and (a + pi, pi - b, c + pi).

    Attributes:
        forearms: indices of the joints that turn a forearm about itself, by side.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        low, high = body.ranges.T
        # A joint that may turn all the way round has no place to come back to.
        self._bound = np.isfinite(low) & (high - low < _TURN - 1e-9)
        self._free = ~self._bound & np.array([not joint.slides for joint in body.joints])
        self._low, self._high = np.where(self._bound, low, -np.inf), np.where(self._bound, high, np.inf)
        self._middle = np.zeros(len(low))
        self._middle[self._bound] = body.ranges[self._bound].mean(axis=1)
        # The mirrored posture of an elbow is the nearest of all that fit nearly as well.
        self._refused = np.array([_SLACK if n.endswith("elbow_flexion") else _REFUSED for n in body.names])
        self.forearms = [body.chains[f"{side}_arm"][4] for side in body.sides]
        self._shoulders = [list(body.chains[f"{side}_arm"][:3]) for side in body.sides]

    def start(self, posture: Sequence[float]) -> Array:
        """(n,) rad with both arms in a posture, degrees of the first joints of the arm."""
        q = np.zeros(len(self._body.joints))
        for side in self._body.sides:
            for joint, angle in zip(self._body.chains[f"{side}_arm"], posture, strict=False):
                q[joint] = np.deg2rad(angle)
        return q

    def excess(self, q: Array) -> Array:
        """(n,) rad: how far each joint is beyond its range."""
        return np.maximum(np.maximum(self._low - q, q - self._high), 0.0)

    def turned(self, q: Array) -> float:
        """rad: how far a forearm is turned beyond its range, at most."""
        return float(self.excess(q)[self.forearms].max())

    def refused(self, q: Array) -> bool:
        """Whether no person has this posture: one that is found where the markers are mirrored."""
        return bool((self.excess(q) > self._refused).any())

    def home(self, q: Array, last: Array) -> Array:
        """The same posture by the angles nearest to their ranges; what turns all the way round is nearest to `last`."""
        q = self._whole(q)
        q = np.where(self._free, q - _TURN * np.round((q - last) / _TURN), q)
        for shoulder in self._shoulders:
            other = self._other_way(q, shoulder)
            if self.excess(other)[shoulder].sum() < self.excess(q)[shoulder].sum():
                q = other
        return q

    def turned_over(self, q: Array, side: Side) -> Array:
        """q with a forearm turned over: where its fit begins if the labels of the wrist were exchanged."""
        other = q.copy()
        other[self._body.chains[f"{side}_arm"][4]] += np.pi
        return self._whole(other)

    def returned(self, q: Array) -> Array:
        """`home`, for the joints and shoulders that it brings nearer to their ranges by more than the slack."""
        beyond = self.excess(q)
        if beyond.max() <= _SLACK:
            return q
        home = self.home(q, q)
        nearer = beyond - self.excess(home)
        for shoulder in self._shoulders:
            nearer[shoulder] = nearer[shoulder].sum()
        found: Array = np.where(nearer > _SLACK, home, q)
        return found

    def ambiguous(self, q: Array) -> Mask:
        """(n,) True for a shoulder near straight forward (or back) whose other angles would stay as well as these.

        Which of the two it has is then its history's. Elsewhere in the joints' ranges only one of them stays.
        """
        found = np.zeros(len(q), bool)
        for shoulder in self._shoulders:
            if abs(abs(remainder(q[shoulder[1]], _TURN)) - 0.5 * pi) >= _SLACK:
                continue
            here, there = self.excess(q)[shoulder], self.excess(self._other_way(q, shoulder))[shoulder]
            found[shoulder] = there.max() <= _SLACK or there.sum() - here.sum() <= _SLACK
        return found

    def _whole(self, q: Array) -> Array:
        turned: Array = q - _TURN * np.round((q - self._middle) / _TURN)
        return np.where(self._bound, turned, q)

    def _other_way(self, q: Array, shoulder: list[int]) -> Array:
        a, b, c = q[shoulder]
        other = q.copy()
        other[shoulder] = a + np.pi, np.pi - b, c + np.pi
        return self._whole(other)


def rigid(places: Array, points: Array) -> tuple[Array, Array]:
    """The rotation and translation that bring places (k, 3) nearest to points (k, 3). (Kabsch 1976)"""
    a, b = places.mean(axis=0), points.mean(axis=0)
    u, _, vt = np.linalg.svd((places - a).T @ (points - b))
    d = np.sign(np.linalg.det(vt.T @ u.T))
    R: Array = vt.T @ np.diag([1.0, 1.0, d]) @ u.T
    return R, b - R @ a
