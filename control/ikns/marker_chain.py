"""Where a body's markers are at its angles, and how they move with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Marker


class MarkerChain:
    """The chain of a body with k markers and n joints, at the angles that were placed last.

    Attributes:
        points: (k, 3) m, the markers.
        places: (k, 3) m, the same in their segments' frames.
        support: (k, n), 1 where a joint moves a marker, else 0.
    """

    def __init__(self, body: Body, markers: Mapping[str, Marker]) -> None:
        n, k = len(body.joints), len(markers)
        self._model = body.model()
        self._data = self._model.createData()
        self._lin, self._ang = self._data.J[:3], self._data.J[3:]  # views, as are those of the poses below
        behind = [body.segments[m.segment] for m in markers.values()]
        self.support = np.zeros((k, n))
        for row, joint in enumerate(behind):
            at = joint
            while at >= 0:
                self.support[row, at] = 1.0
                at = body.joints[at].parent
        self.places = np.array([m.at for m in markers.values()]).reshape(k, 3)
        self._segments: list[tuple[slice | NDArray[np.intp], Array, Array, Array]] = []
        for joint in dict.fromkeys(behind):
            rows = np.flatnonzero(np.array(behind) == joint)
            pose = self._data.oMi[joint + 1]
            together = slice(int(rows[0]), int(rows[-1]) + 1)  # several times as fast as an index
            index = together if together.stop - together.start == len(rows) else rows
            self._segments.append((index, self.places[rows], pose.rotation.T, pose.translation))
        self.points = np.zeros((k, 3))
        # S(p) with S(p) w = w x p, from p by one product.
        self._skew = np.zeros((3, 9))
        for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            self._skew[axis, 3 * i + j], self._skew[axis, 3 * j + i] = 1.0, -1.0

    def place(self, q: Array) -> None:
        """Computes the chain and the points at q (n,) rad and m."""
        pin.computeJointJacobians(self._model, self._data, q)
        for rows, places, turn, shift in self._segments:
            self.points[rows] = places @ turn + shift

    def pose(self, joint: int) -> Any:
        """The pose (`pinocchio.SE3`) of what a joint carries, m; a view that the next `place` changes."""
        return self._data.oMi[joint + 1]

    def jacobian(self, active: Array) -> Array:
        """(3 k, n): of the points, m per rad or m; zero where `active` (broadcast to (k, 3, n)) is."""
        J = (self.points @ self._skew).reshape(-1, 3, 3) @ self._ang
        J += self._lin
        J *= active
        return J.reshape(-1, J.shape[2])

    def distance(self, goal: Array) -> Array:
        """(k,) m, from the points to goal (k, 3) m."""
        left = goal - self.points
        found: Array = np.sqrt(np.einsum("ij,ij->i", left, left))
        return found

    def wrong(self, goal: Array, gate: float, distance: Array) -> Array:
        """(k,) m: the distances; infinite for a point that is much nearer to another marker's place than to its own."""
        far = np.flatnonzero(distance > 0.5 * gate)
        if not len(far):
            return distance
        apart = goal[far, None] - self.points
        nearest = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart).min(axis=1))
        distance = distance.copy()
        distance[far[nearest < 0.5 * distance[far]]] = np.inf
        return distance
