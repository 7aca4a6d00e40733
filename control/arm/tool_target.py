"""Where an arm's tool is to go: a pose or a point in a frame that may move, as it is in the arm's base."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.rotation import Quaternion
from srl.runtime.contracts.signals import Array

_OFF: Final = 0.1  # by which a quaternion's length may be off 1
_FASTEST: Final = 5.0  # m/s: what goes from one cycle to the next is a jump, and no motion to be led by


class ToolTarget:
    """The target, with the velocity at which it moves.

    Attributes:
        position: (3,) m.
        turn: w x y z; None: only a point is followed.
        velocity: (3,) m/s of the target, through a low-pass; zero after a jump.
    """

    def __init__(self, smooth: float, offset: tuple[float, float, float]) -> None:
        """`smooth`: s, of the velocity; `offset`: m, added to the place in the target's own coordinates."""
        self._smooth, self._offset = smooth, np.array(offset)
        self.position: Array = np.zeros(3)
        self.turn: Quaternion | None = None
        self.velocity: Array = np.zeros(3)
        self._known = False

    def reset(self) -> None:
        """Forgets what it has seen."""
        self.velocity = np.zeros(3)
        self._known = False

    def update(self, target: Array, into: Array, dt: float) -> bool:
        """Takes the newest target. Returns whether it is there.

        Args:
            target: (7,) m and w x y z, or (3,) m.
            into: (7,) the pose of its frame in the arm's base.
        """
        found = self._found(target, into)
        if found is None:
            self.velocity = np.zeros(3)
            self._known = False
            return False
        position, turn = found
        if self._known and dt > 0.0:
            rate = (position - self.position) / dt
            if float(np.linalg.norm(rate)) > _FASTEST:
                self.velocity = np.zeros(3)
            else:
                self.velocity = self.velocity + dt / (dt + self._smooth) * (rate - self.velocity)
        self.position, self.turn, self._known = position, turn, True
        return True

    def _found(self, target: Array, into: Array) -> tuple[Array, Quaternion | None] | None:
        if not (np.isfinite(target).all() and np.isfinite(into).all()):
            return None
        x, y, z, *frame = into.tolist()
        placed = _unit((frame[0], frame[1], frame[2], frame[3]))
        if placed is None:
            return None
        a, b, c = (target[:3] + self._offset).tolist()
        position = np.array((x, y, z)) + np.array(rotation.turned(placed, (a, b, c)))
        if len(target) == 3:
            return position, None
        w, i, j, k = target[3:].tolist()
        turn = _unit((w, i, j, k))
        return None if turn is None else (position, rotation.product(placed, turn))


def _unit(q: Quaternion) -> Quaternion | None:
    size = sum(v * v for v in q) ** 0.5
    if not isfinite(size) or abs(size - 1.0) > _OFF:
        return None
    return rotation.normalised(q)
