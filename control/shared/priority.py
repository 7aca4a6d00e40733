"""The priority between arm and base, and the configuration preferred in locomotion (Giammarino et al. 2022, III-B2)."""

from __future__ import annotations

from math import exp, log

import numpy as np

from srl.runtime.contracts.signals import Array


class Priority:
    """Changes from manipulation to locomotion and back over a blend time, so that the switch makes no step.

    At the switch to locomotion, the present configuration becomes the preferred one. The old one fades out over the
    blend time as well, as it may still have an effect.

    Attributes:
        level: 0 in manipulation, 1 in locomotion.
        preferred: q_pref (n,) rad.
    """

    def __init__(self, n: int, blend: float) -> None:
        """blend: blend time, s; 0: switches at once."""
        self._blend = blend
        self.level = 0.0
        self.preferred = np.zeros(n)
        self._chosen, self._offset = np.zeros(n), np.zeros(n)
        self._fade = 0.0  # share of the old preference that is left
        self._locomotion = False

    def reset(self, locomotion: bool, q: Array) -> None:
        """Starts in this priority, with q (n,) as the preferred configuration."""
        self._locomotion, self.level, self._fade = locomotion, float(locomotion), 0.0
        self._chosen[:] = self.preferred[:] = q

    def update(self, locomotion: bool, q: Array, dt: float) -> None:
        """Computes one step of dt seconds with the arm at q (n,)."""
        step = dt / self._blend if self._blend > 0.0 else 1.0
        if locomotion and not self._locomotion:
            self._chosen[:] = q
            np.subtract(self.preferred, q, out=self._offset)
            self._fade = 1.0
        self._locomotion = locomotion
        self.level = min(self.level + step, 1.0) if locomotion else max(self.level - step, 0.0)
        if self._fade > 0.0:
            self._fade = max(self._fade - step, 0.0)
            np.multiply(self._offset, self._fade, out=self.preferred)
            self.preferred += self._chosen

    def between(self, manipulation: float, locomotion: float) -> float:
        """Interpolates linearly between two values at the present level."""
        return manipulation + self.level * (locomotion - manipulation)

    def between_ratios(self, manipulation: float, locomotion: float) -> float:
        """Interpolates the logarithm linearly at the present level: for weights, of which only ratios matter."""
        if self.level in (0.0, 1.0):
            return locomotion if self.level else manipulation
        return exp(log(manipulation) + self.level * (log(locomotion) - log(manipulation)))
