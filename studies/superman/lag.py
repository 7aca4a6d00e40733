"""How late a guided robot is: the shift between its motion and the motion that the bare law makes of the force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

_LONGEST: Final = 0.3  # s, greatest delay that is searched


def lag(
    t: Array, force: Array, velocity: Array, mass: Sequence[float], damping: Sequence[float], dead_band: float
) -> float:
    """Returns the s by which the handle's motion is behind the motion that the bare law makes of the force at once.

    It is the shift with the greatest correlation of the two over the whole recording, interpolated between samples by a
    parabola.

    Args:
        t: (k,) s.
        force: (k, 3) N, of the hand.
        velocity: (k, 3) m/s, of the handle.
        mass, damping: the first three of M_adm and D_adm, kg and N s/m.
        dead_band: N.
    """
    dt = float(np.median(np.diff(t)))
    M, D = np.array(mass[:3]), np.array(damping[:3])
    ideal, v = np.zeros_like(force), np.zeros(3)
    for k, f in enumerate(force):
        size = float(np.linalg.norm(f))
        beyond = f * max(0.0, 1.0 - dead_band / size) if size > 0 else f
        v = v + dt * (beyond - D * v) / M
        ideal[k] = v
    most = min(round(_LONGEST / dt), len(t) // 2)
    n = len(t) - most
    match = []
    for k in range(most):
        x, y = ideal[:n].ravel(), velocity[k : k + n].ravel()
        size = float(np.linalg.norm(x)) * float(np.linalg.norm(y))
        match.append(float(x @ y) / max(size, 1e-12))
    best = int(np.argmax(match))
    if 0 < best < most - 1:
        low, top, high = match[best - 1 : best + 2]
        if (bend := low - 2 * top + high) < 0:
            return dt * (best + 0.5 * (low - high) / bend)
    return dt * best
