"""Computes the points of many chains at once, as one trigonometric sum."""

from __future__ import annotations

from typing import Final, cast

import numpy as np

from srl.runtime.contracts.signals import Array

_ZERO: Final = 1e-15  # m or 1, below which a coefficient is rounding


class PointSeries:
    """The ends of the rows of k chains of n revolute joints, for chains as in `kinematics.Chain`.

    A row's transformation is C cos q + S sin q + K, which is a sum of exp(i s q) with s = -1, 0, 1. So a point is
    p = Re sum_s P_s exp(i s . q) over the sums and differences s . q of joint angles that occur. Four joints of
    a finger need about ten. All P_s are constant, so an update is two products and a cosine and sine.
    """

    def __init__(self, bases: Array, rows: Array) -> None:
        """Args:
        bases: (k, 4, 4), each chain's base in the common frame, m.
        rows: (k, n, 2), alpha (rad) and a (m) of each row.
        """
        k, n = rows.shape[:2]
        series = [_expand(base, chain) for base, chain in zip(bases, rows, strict=True)]
        terms = [(i, s, P) for i, found in enumerate(series) for s, P in found.items()]
        self._S = np.zeros((len(terms), k * n))
        self._P = np.zeros((3 * k * n, 2 * len(terms)))
        for m, (i, s, P) in enumerate(terms):
            self._S[m, n * i : n * (i + 1)] = s
            at = slice(3 * n * i, 3 * n * (i + 1))
            self._P[at, m], self._P[at, len(terms) + m] = P.real.ravel(), -P.imag.ravel()
        self._waves = np.empty((2, len(terms)))

    def at(self, q: Array) -> Array:
        """Returns the rows' ends (k n, 3), m, chain by chain, for joint angles q (k n,), rad."""
        phases = self._S.dot(q)
        np.cos(phases, out=self._waves[0])
        np.sin(phases, out=self._waves[1])
        return cast(Array, self._P.dot(self._waves.ravel()).reshape(-1, 3))


def _expand(base: Array, rows: Array) -> dict[tuple[int, ...], Array]:
    """Returns P_s (n, 3), complex, by s. It has only one of s and -s, as the other is its conjugate."""
    n = len(rows)
    frames: dict[tuple[int, ...], Array] = {(0,) * n: base}
    series: dict[tuple[int, ...], Array] = {}
    for j, (alpha, a) in enumerate(rows.tolist()):
        ca, sa = np.cos(alpha), np.sin(alpha)
        C = np.array([[1.0, 0.0, 0.0, a], [0.0, ca, -sa, 0.0], [0.0] * 4, [0.0] * 4])
        S = np.array([[0.0, -ca, sa, 0.0], [1.0, 0.0, 0.0, a], [0.0] * 4, [0.0] * 4])
        K = np.array([[0.0] * 4, [0.0] * 4, [0.0, sa, ca, 0.0], [0.0, 0.0, 0.0, 1.0]])
        waves = {-1: 0.5 * (C + 1j * S), 0: K, 1: 0.5 * (C - 1j * S)}
        frames = {(*s[:j], sign, *s[j + 1 :]): F @ W for s, F in frames.items() for sign, W in waves.items()}
        frames = {s: F for s, F in frames.items() if np.abs(F).max() > _ZERO}
        for s, F in frames.items():
            # s and -s together give twice the real part.
            if s >= (0,) * n and np.abs(F[:3, 3]).max() > _ZERO:
                series.setdefault(s, np.zeros((n, 3), complex))[j] = F[:3, 3] * (2.0 if any(s) else 1.0)
    return series
