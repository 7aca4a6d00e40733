"""The virtual object between the fingertips: how the human points move it, and how it moves others.

Prattichizzo et al., RO-MAN 2014, equations (1) to (4). Notation: p_h (n_h, 3) human reference points, p_a
robotic ones, c the centroid of p_h, o and r the virtual sphere's centre and radius.
"""

from __future__ import annotations

from enum import StrEnum
from math import sqrt
from typing import Final, cast

import numpy as np

from runtime.signals import Array

_NULL: Final = 1e-12  # an eigenvalue of A^T A below this share of the largest is a zero
_POINT: Final = 1e-12  # m^2, below which the largest is one: all points coincide
_STEP: Final = 1.0  # greatest norm of one step's deformation gradient; more is a fault of the input
_TWIST: Final = 0.2  # turns about the line through points flatter than this are held back, see `similarity`

_I: Final = np.eye(3)
_IDENTITY: Final = np.diag([3.0, -1.0, -1.0, -1.0])  # N of Horn for a^T b = I
_ROTATIONS: Final = np.array(  # S(e_x), S(e_y), S(e_z): S(w) p = w x p
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ]
)
_STRETCHES: Final = np.array([np.diag(row) for row in _I])
_SHEARS: Final = np.abs(_ROTATIONS)


class Deformation(StrEnum):
    """What the object may do besides moving rigidly."""

    RIGID = "rigid"
    ISOTROPIC = "isotropic"  # the paper's: one ds
    NON_ISOTROPIC = "non-isotropic"  # three stretches along the hand's axes
    SHEAR = "shear"  # the three and three shears: any affine map


class Psi(StrEnum):
    """What fills the null space N_A of (3)."""

    NONE = "none"  # nothing: no rotation or deformation about c that the points don't show
    MINIMUM_NORM = "minimum-norm"  # smallest |do|, r |dPhi|, r |ds| about the sphere's centre
    MAXIMISE_SCALE = "maximise-scale"  # as much as can be by deformation, the least by do and dPhi


_BASES: Final = {
    Deformation.RIGID: _ROTATIONS,
    Deformation.ISOTROPIC: np.concatenate([_ROTATIONS, _I[None]]),
    Deformation.NON_ISOTROPIC: np.concatenate([_ROTATIONS, _STRETCHES]),
    Deformation.SHEAR: np.concatenate([_ROTATIONS, _STRETCHES, _SHEARS]),
}


class VirtualObject:
    """Estimates the object's motion from the human points and applies it to others.

    With G = S(dPhi) + ds I (or a richer deformation), (1) is dp = do + G (p - o). It is taken about c, where
    the translation is the points' mean motion and separates from G; do about o follows. Both sides are
    evaluated in the middle of the step, which makes a finite rotation or scaling exact (Cayley), not only a
    small one.

    Damping is selective: a direction of G (an eigenvector of A^T A) is left as it is unless one metre at the
    fingertips along it would become more than `gain_limit` metres at a robotic tip; its share then falls with
    the square of the excess. A translation is never damped.
    """

    def __init__(self, deformation: Deformation, psi: Psi, gain_limit: float) -> None:
        self._B = _BASES[deformation]
        self._Bt = np.ascontiguousarray(self._B.transpose(0, 2, 1))
        self._flat = self._B.reshape(-1, 9)
        self._psi = psi
        self._limit2 = gain_limit**2

    def move(self, before: Array, after: Array, p_a: Array, sphere: Array) -> Array:
        """Robotic points (m, 3) after the object's motion, equation (4).

        Args:
            before, after: (n_h, 3) human points at both ends of the step.
            p_a: (m, 3) robotic points before it.
            sphere: (4,) centre and radius before it; only `psi` asks for it.
        """
        mid = 0.5 * (before + after)
        dp = after - before
        n = len(mid)
        c, v = mid.sum(axis=0) / n, dp.sum(axis=0) / n
        A, lam, W, inverse = self._decompose(mid - c, p_a - c)
        xi = W @ (inverse * (W.T @ (A @ dp.ravel())))  # (3), A^+ dp_h
        if self._psi is not Psi.NONE:
            xi = xi + self._null_motion(
                W[:, lam <= _null_below(lam[-1])], xi, v, sphere[:3] - c, float(sphere[3])
            )
        norm = sqrt(xi @ xi)
        if norm > _STEP:
            xi *= _STEP / norm
        G = (xi @ self._flat).reshape(3, 3)
        # p' - p = v + G ((p' + p) / 2 - c), solved for p' - p
        x = p_a - c
        return cast(Array, p_a + (v + x @ G.T) @ _inverse(_I - 0.5 * G).T)

    def noise_gain(self, p_h: Array, p_a: Array) -> tuple[float, float]:
        """Of the worst robotic tip, its rms motion over the fingertips' rms noise: damped, undamped.

        |K|_F / sqrt(3) of the matrix K in dp_a = K dp_h, for noise that is independent in every coordinate.
        """
        n, c = len(p_h), p_h.mean(axis=0)
        A, lam, W, damped = self._decompose(p_h - c, p_a - c)
        null = _null_below(lam[-1])
        undamped = np.array([1.0 / x if x > null else 0.0 for x in lam.tolist()])
        mean = np.tile(_I, n) / n
        gains: list[float] = []
        for inverse in (damped, undamped):
            X = (W * inverse) @ W.T @ A
            gains.append(max(float(np.linalg.norm(mean + self._effect(p - c) @ X)) for p in p_a) / sqrt(3.0))
        return gains[0], gains[1]

    def _decompose(self, d: Array, x: Array) -> tuple[Array, Array, Array, Array]:
        """A^T (k, 3 n_h) of (2) about c; eigenvalues, eigenvectors (k, k), damped inverses of A^T A."""
        k = len(self._B)
        A = (d @ self._Bt).reshape(k, -1)
        lam, W = np.linalg.eigh(A @ A.T)
        # Metres at the robotic tips for one unit along each direction, the largest of the tips.
        E = (W.T @ (x @ self._Bt).reshape(k, -1)).reshape(k, -1, 3)
        reach2 = (E * E).sum(axis=2).max(axis=1)
        # gain^2 = reach2 / lam, and the factor min(1, limit^2 / gain^2) on 1 / lam
        null, bound = _null_below(lam[-1]), (reach2 / self._limit2).tolist()
        inverse = np.array(
            [1.0 / max(x, low) if x > null else 0.0 for x, low in zip(lam.tolist(), bound, strict=True)]
        )
        return A, lam, W, inverse

    def _effect(self, x: Array) -> Array:
        """(3, k): a point's motion, at x from c, for one unit of each parameter."""
        return (self._B @ x).T

    def _null_motion(self, Z: Array, xi: Array, v: Array, o: Array, r: float) -> Array:
        """N_A psi (k,): makes |do|, r |dPhi| (and, for the minimum norm, r |ds|) about o smallest."""
        scale = np.full(len(xi), r)
        if self._psi is Psi.MAXIMISE_SCALE:
            scale[3:] = 0.0
        F = self._effect(o)  # do about o = v + F xi
        rows = np.concatenate([F, np.diag(scale)])
        rest = rows @ xi
        rest[:3] += v
        return cast(Array, Z @ np.linalg.lstsq(rows @ Z, -rest, rcond=1e-9)[0])


def similarity(reference: Array, points: Array, p_a: Array, rigid: bool) -> Array:
    """Robotic points p_a (m, 3) carried by the finite similarity that takes `reference` (n, 3) to `points`.

    Least squares, the rotation from Horn's quaternion (1987). Where the points are nearly on a line the turn
    about it is ill-defined and would jump; it is drawn toward the identity there, continuously, so that any
    number of points will do.
    """
    n = len(points)
    c0, c1 = reference.sum(axis=0) / n, points.sum(axis=0) / n
    a, b = reference - c0, points - c1
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (a.T @ b).tolist()
    N = np.array(
        [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, yy - xx - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, zz - xx - yy],
        ]
    )
    lam, Q = np.linalg.eigh(N)
    # With the singular values s of a^T b, the last signed by its determinant, the two largest are
    # s_1 + s_2 + s_3 and s_1 - s_2 - s_3: their gap tells how firmly the turn is held.
    second, first = lam[2:].tolist()
    if first + second < _POINT:
        return cast(Array, p_a - c0 + c1)
    lack = _TWIST - (first - second) / (first + second)
    if lack > 0.0:
        Q = np.linalg.eigh(N + 0.5 * lack * (first + second) * _IDENTITY)[1]
        first = float(Q[:, 3] @ N @ Q[:, 3])
    w, x, y, z = Q[:, 3].tolist()
    R = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    scale = 1.0 if rigid else max(first / float((a * a).sum()), 0.0)
    return cast(Array, c1 + scale * (p_a - c0) @ R.T)


def _inverse(M: Array) -> Array:
    """The inverse (3, 3) by cofactors, for M near the identity."""
    (a, b, c), (d, e, f), (g, h, i) = M.tolist()
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    adjugate = np.array(
        [
            [A, c * h - b * i, b * f - c * e],
            [B, a * i - c * g, c * d - a * f],
            [C, b * g - a * h, a * e - b * d],
        ]
    )
    return cast(Array, adjugate / (a * A + b * B + c * C))


def _null_below(largest: float) -> float:
    """The bound up to which eigenvalues of A^T A are zeros; all are, if the points coincide."""
    return _NULL * largest if largest > _POINT else np.inf
