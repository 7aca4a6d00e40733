"""Outlier rejection of an arm's measured joints: a value that no motion explains is rejected, unless it lasts."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

SLACK: Final = 0.05  # rad or m, by which one sample may be off the motion
LONGEST: Final = 0.05  # s, for which the last accepted joints stand for rejected ones
UNKNOWN: Final = 10.0  # rad/s or m/s, of a joint whose greatest speed nobody says


class AcceptedPositions:
    """The measured joints, without samples that can't be.

    A sample is rejected if a joint would have moved since the last accepted one by more than twice its greatest speed
    and `SLACK` explain. The longer that lasts, the more motion explains it, until it is accepted.

    Attributes:
        q: (n,) rad or m, as accepted last; NaN before there was any.
        known: whether `q` may be used: it is that of now, or was rejected for `LONGEST` at most.
        anew: in this cycle the joints are known again after `LONGEST` or more: they may be elsewhere.
        missing: s, since when they aren't known.
    """

    def __init__(self, speed: Array) -> None:
        """`speed`: (n,) rad/s or m/s, the joints' greatest."""
        self._speed = 2.0 * np.where(np.isfinite(speed), speed, UNKNOWN)
        self.q: Array = np.full(len(speed), np.nan)
        self.known = self.anew = False
        self.missing = self._age = 0.0

    def reset(self, q: Array) -> None:
        """Begins at this sample."""
        self.known = bool(np.isfinite(q).all())
        self.q[:] = q if self.known else np.nan
        self.anew = False
        self.missing = self._age = 0.0

    def update(self, q: Array, dt: float) -> None:
        """Takes the sample of this cycle, `dt` seconds after the one before."""
        self._age += dt
        finite, first = bool(np.isfinite(q).all()), bool(np.isnan(self.q).any())
        if finite and (first or bool((np.abs(q - self.q) <= SLACK + self._speed * self._age).all())):
            self.known, self.anew = True, first or self._age > LONGEST
            self.q[:] = q
            self.missing = self._age = 0.0
            return
        self.known, self.anew = finite and not first and self._age <= LONGEST, False
        self.missing = 0.0 if self.known else self.missing + dt
