"""Which joints of a body a set of markers shows."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

Mask = NDArray[np.bool_]

_WEAK: Final = 60.0  # rad/m: an angle that 1 mm of noise moves by more than 0.06 rad isn't observed
_SETS: Final = 256  # of markers, at most, for which it is kept what they show; the oldest goes first


class Observability:
    """Judged in one fixed posture, so that it depends on nothing but the markers."""

    def __init__(self, jacobian: Array, support: Array) -> None:
        """
        Args:
            jacobian: (3 k, n), the derivative of all markers in that posture.
            support: (k, n), 1 where a joint moves a marker.
        """
        self._rows = jacobian.reshape(len(support), 3, -1)
        self._support = support
        self.kept: dict[bytes, tuple[Array, Mask]] = {}

    def of(self, use: Mask) -> tuple[Array, Mask]:
        """What of a Jacobian counts with these markers (k,), (k, 1, n), and the joints that they don't show, (n,)."""
        key = use.tobytes()
        if key in self.kept:
            return self.kept[key]
        n = self._support.shape[1]
        free = np.arange(n)
        rows = self._rows[use].reshape(-1, n)
        information = rows.T @ rows + 1e-9 * np.eye(n)
        while len(free):
            sd = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(free, free)])))
            worst = int(sd.argmax())
            if sd[worst] <= _WEAK:
                break
            free = np.delete(free, worst)
        held = np.ones(n, bool)
        held[free] = False
        active = (self._support * use[:, None] * ~held)[:, None, :]
        if len(self.kept) >= _SETS:
            del self.kept[next(iter(self.kept))]
        self.kept[key] = (active, held)
        return active, held
