"""Whether a measured velocity is that of the measured position: else a torque that damps it would drive the joint."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.runtime.contracts.compiled import bind_or_python
from srl.runtime.contracts.signals import Array

MEMORY: Final = 0.5  # s, in which a difference of the two ways is forgotten
OFF: Final = {"rad/s": 0.05, "m/s": 0.01}  # rad or m, by which the ways may differ: noise, resolution
LATE: Final = 0.06  # s of motion, at most, by which they differ: a filter, a scale that is off by a tenth
MOST: Final = 1.5  # times what is normal: more isn't remembered, so that one which is right again soon counts
SMOOTH: Final = 0.01  # s, time constant of the position's own speed
LASTS: Final = 0.3  # s, longer than what one wrong sample leaves behind: then the device is at fault


class RateCheck:
    """Compares the way that a velocity says with the way that the position went, by element.

    Both are forgotten with the time constant MEMORY. They may differ by OFF, and by LATE times the greatest speed that
    both agree on. What is wrong by less, for ever, isn't found: 0.1 rad/s, or 12 % of a joint's speed. A velocity that
    is wrong is replaced by the speed of the position, smoothed: what relies on it goes on.

    Attributes:
        wrong_for: s for which a velocity has been wrong.
    """

    def __init__(self, position: Array, velocity: Array, unit: str) -> None:
        """
        Args:
            position: (n,), of the same joints in the same order.
            velocity: (n,), replaced where it is wrong.
            unit: of the velocity.
        """
        self._velocity, self._position = velocity, position
        # By element: the position and the velocity before, velocity's way less position's, the greatest common speed,
        # the speed of the position, whether the velocity is wrong.
        self._state = np.zeros((velocity.size, 6))
        self._off = np.full(velocity.size, OFF.get(unit, OFF["rad/s"]))
        self._step = bind_or_python("rate-check", position, velocity, self._off, self._state)
        self.restart()

    def restart(self) -> None:
        """Begins with the next sample."""
        self._state[:] = 0.0
        self._state[:, :2] = np.nan
        self.wrong_for = 0.0

    def step(self, dt: float) -> int:
        """Judges a sample that came dt s after the one before. Returns an element that is wrong, or -1."""
        if (found := self._step(dt, False)) < 0:
            found = self._compute(dt)
        self.wrong_for = self.wrong_for + dt if found else 0.0
        return found - 1

    def replace(self) -> None:
        """Puts the speed of the position where the velocity is wrong."""
        wrong = self._state[:, 5] != 0.0
        self._velocity[wrong] = self._state[wrong, 4]

    def _compute(self, dt: float) -> int:
        """What C does, in Python: one more than an element that is wrong, 0 for none."""
        q, w = self._position, self._velocity
        before, speed, way, common, own, _ = self._state.T
        keep, share = max(0.0, 1.0 - dt / MEMORY), dt / (dt + SMOOTH)
        known = np.isfinite(q) & np.isfinite(w)
        goes_on = known & np.isfinite(before) & (dt > 0.0)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            went = q - before
            new = way * keep
            new[goes_on] = new[goes_on] + (0.5 * (w + speed) * dt - went)[goes_on]
            common = common * keep
            common[goes_on] = np.maximum(common, np.minimum(np.abs(w), np.abs(went) / dt))[goes_on]
            own = own.copy()
            own[goes_on] = own[goes_on] + ((went / dt - own) * share)[goes_on]
        most = self._off + LATE * common
        wrong = known & ~(np.abs(new) <= most)
        new = np.clip(new, -MOST * most, MOST * most)
        self._state[:, 0], self._state[:, 1] = np.where(known, q, np.nan), np.where(known, w, np.nan)
        self._state[:, 2:] = np.stack([new, common, own, wrong], axis=1)
        return int(np.argmax(wrong)) + 1 if wrong.any() else 0
