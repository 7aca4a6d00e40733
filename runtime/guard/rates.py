"""Whether a measured velocity is that of the measured position: else a torque that damps it would drive the joint."""

from __future__ import annotations

from typing import Final

import numpy as np

from runtime.contracts.compiled import bind_or_python
from runtime.contracts.signals import Array

MEMORY: Final = 0.5  # s, in which a difference of the two ways is forgotten
OFF: Final = {"rad/s": 0.05, "m/s": 0.01}  # rad or m, by which the ways may differ: noise, resolution
MOST: Final = 2.0  # times what is normal: more isn't remembered, so that one which is right again soon counts
LATE: Final = 0.06  # s of motion, at most, by which they differ: a filter, a scale that is off by a tenth


class RateCheck:
    """Compares the way that a velocity says with the way that the position went, by element.

    Both are forgotten with the time constant MEMORY. They may differ by OFF, and by LATE times the greatest speed that
    both agree on. What is wrong by less, for ever, isn't found: 0.1 rad/s, or 12 % of a joint's speed.

    Attributes:
        velocity: (n,), of the newest sample.
    """

    def __init__(self, position: Array, velocity: Array, unit: str) -> None:
        """
        Args:
            position: (n,), of the same joints in the same order.
            velocity: (n,).
            unit: of the velocity.
        """
        self.velocity, self._position = velocity, position
        # By element: the position and the velocity before, velocity's way less position's, the greatest common speed.
        self._state = np.zeros((velocity.size, 4))
        self._off = np.full(velocity.size, OFF.get(unit, OFF["rad/s"]))
        self._step = bind_or_python("rate-check", position, velocity, self._off, self._state)
        self.restart()

    def restart(self) -> None:
        """Begins with the next sample."""
        self._state[:] = 0.0
        self._state[:, :2] = np.nan

    def step(self, dt: float) -> int:
        """Judges the sample, dt s after the one before. Returns an element that is wrong, or -1."""
        if (found := self._step(dt, False)) >= 0:
            return found - 1
        q, w = self._position, self.velocity
        before, speed, way, common = self._state.T
        keep = max(0.0, 1.0 - dt / MEMORY)
        known = np.isfinite(q) & np.isfinite(w)
        with np.errstate(invalid="ignore", over="ignore"):
            went = q - before
            both = np.minimum(np.abs(w), np.abs(went) / dt) if dt > 0.0 else np.zeros(q.size)
            new = way * keep + (0.5 * (w + speed) * dt - went)
            common = np.maximum(common * keep, both)
        began = known & ~np.isfinite(before)
        new[began] = common[began] = 0.0
        most = self._off + LATE * common
        wrong = known & ~(np.abs(new) <= most)
        new = np.clip(new, -MOST * most, MOST * most)
        self._state[known] = np.stack([q, w, new, common], axis=1)[known]
        return int(np.argmax(wrong)) if wrong.any() else -1
