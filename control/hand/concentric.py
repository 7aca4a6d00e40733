"""A virtual object that only grows and shrinks about its centre: what holds it closes on it from all sides. Ours.

Prattichizzo et al., IEEE/ASME AIM 2014, explain what the fingertips have in common as a motion of the object. A hand
that closes toward the extra finger thus pushes it away. Here the same motion is a smaller object, and the finger comes
to meet them.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from srl.runtime.contracts.signals import Array

_POINT = 1e-12  # m^2: points that near to the centre, all of them, don't tell a size


class ConcentricObject:
    """Its centre o stays where it is at the start, that of the smallest sphere around all points, human and robotic.

    Of equation (1) only dp_h = ds (p_h - o) is left. Its least-squares solution ds = sum d . dp / sum |d|^2 with
    d = p_h - o is the change of log sqrt(sum |d|^2). So the size is that root, and nothing drifts.
    """

    def __init__(self, p_h: Array, p_a: Array, centre: Array) -> None:
        """Args:
        p_h: (n_h, 3) m, human points at the start.
        p_a: (m, 3) m, robotic points at the start.
        centre: (3,) m.
        """
        self._centre, self._from = centre.copy(), p_a - centre
        self._size2 = self._squares(p_h)

    def _squares(self, p_h: Array) -> float:
        return float(((p_h - self._centre) ** 2).sum())

    def carry(self, p_h: Array) -> Array:
        """The robotic points (m, 3) for present human points (n_h, 3)."""
        scale = sqrt(self._squares(p_h) / self._size2) if self._size2 > _POINT else 1.0
        found: Array = self._centre + scale * self._from
        return found

    def noise_gain(self, p_h: Array) -> float:
        """The rms motion of the worst robotic tip divided by the fingertips' rms noise; 0 for a size of 0."""
        squares = self._squares(p_h)
        if self._size2 <= _POINT or squares <= _POINT:
            return 0.0
        # dp_a = (p_a - o) / |p_a - o| x (|p_a0 - o| / size0) d^T dp / sqrt(squares): |K|_F is the middle factor.
        return float(np.linalg.norm(self._from, axis=1).max()) / sqrt(3.0 * self._size2)
