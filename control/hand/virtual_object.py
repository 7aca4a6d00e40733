"""The virtual object between the fingertips: how the human points move it, and how it moves other points.

Prattichizzo et al., IEEE/ASME AIM 2014, equations (1) to (4). Notation: p_h (n_h, 3) human reference points, p_a
robotic points, c the centroid of p_h, o and r the virtual sphere's centre and radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from math import sqrt
from typing import Final, cast

import numpy as np

from srl.control.shared.symmetric import (
    FIRM,
    Symmetric,
    Vector,
    dot,
    gram,
    inverse,
    is_above,
    mean,
    products,
    times,
)
from srl.runtime.contracts.rotation import matrix
from srl.runtime.contracts.signals import Array

_NULL: Final = 1e-12  # an eigenvalue of A^T A below this share of the largest counts as zero
_POINT: Final = 1e-12  # m^2; if the largest eigenvalue is below this, it is zero, too: all points coincide
_STEP: Final = 1.0  # greatest norm of one step's deformation gradient; a larger one is a fault of the input
_TWIST: Final = 0.2  # rotations about the line through points flatter than this are held back, see `Similarity`
_NEWTON: Final = 6  # steps; six reach the last bit for any firm K

Rows = tuple[Vector, Vector, Vector]
"""Of a matrix (3, 3)."""

_I: Final = np.eye(3)
_SAME: Final[Rows] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
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
    """The deformations that the object may have in addition to rigid motion."""

    RIGID = "rigid"
    SCALING = "scaling"  # one ds and no turn: ours, see docs/object-mapping.md
    CONCENTRIC = "concentric"  # one ds about the sphere's centre and nothing else: ours, `concentric.py`
    ISOTROPIC = "isotropic"  # the paper's: one ds
    NON_ISOTROPIC = "non-isotropic"  # three stretches along the hand's axes
    SHEAR = "shear"  # the three and three shears: any affine map


class Psi(StrEnum):
    """The motion in the null space N_A of (3)."""

    NONE = "none"  # nothing: no rotation or deformation about c that the points don't show
    MINIMUM_NORM = "minimum-norm"  # smallest |do|, r |dPhi|, r |ds| about the sphere's centre
    MAXIMISE_SCALE = "maximise-scale"  # as much as possible by deformation, as little as possible by do and dPhi


_BASES: Final = {
    Deformation.RIGID: _ROTATIONS,
    Deformation.SCALING: _I[None],
    Deformation.CONCENTRIC: _I[None],  # `ConcentricObject` moves the points instead
    Deformation.ISOTROPIC: np.concatenate([_ROTATIONS, _I[None]]),
    Deformation.NON_ISOTROPIC: np.concatenate([_ROTATIONS, _STRETCHES]),
    Deformation.SHEAR: np.concatenate([_ROTATIONS, _STRETCHES, _SHEARS]),
}


class VirtualObject:
    """Estimates the object's motion from the human points and applies it to other points.

    With G = S(dPhi) + ds I (or a richer deformation), (1) is dp = do + G (p - o). It is taken about c, where
    the translation is the points' mean motion and separates from G; do about o follows. Both sides are
    evaluated in the middle of the step. This makes a finite rotation or scaling exact (Cayley), not only a
    small one.

    Damping is selective. A direction of G (an eigenvector of A^T A) stays unchanged unless one metre at the
    fingertips along it would become more than `gain_limit` metres at a robotic tip. Its share then falls with
    the square of the excess. A translation is never damped.

    A rotation and one scale separate, too: without damping, they have a closed form.
    """

    def __init__(self, deformation: Deformation, psi: Psi, gain_limit: float) -> None:
        self._B = _BASES[deformation]
        self._Bt = np.ascontiguousarray(self._B.transpose(0, 2, 1))
        self._flat = self._B.reshape(-1, 9)
        self._psi = psi
        self._limit2 = gain_limit * gain_limit  # of a number too large for its square: infinity, which is none
        self.share = 1.0 / max(self._limit2, 1e-300)
        self._rotations = 0 if deformation is Deformation.SCALING else 3  # come first among the parameters
        self._scales = deformation is Deformation.ISOTROPIC
        self.is_similar = deformation in (Deformation.ISOTROPIC, Deformation.RIGID)

    def move(self, before: Array, after: Array, p_a: Array, sphere: Array) -> Array:
        """Returns the robotic points (m, 3) after the object's motion, equation (4).

        Args:
            before, after: (n_h, 3) human points at both ends of the step.
            p_a: (m, 3) robotic points before the step.
            sphere: (4,) centre and radius before the step; only `psi` needs it.
        """
        mid = 0.5 * (before + after)
        dp = after - before
        points, ways = mid.tolist(), dp.tolist()
        c, v = mean(points), mean(ways)
        if self.is_similar:
            moved = self._move_similarly([(x - c[0], y - c[1], z - c[2]) for x, y, z in points], ways, c, v, p_a)
            if moved is not None:
                return moved
        return self._move_generally(mid, dp, np.array(c), np.array(v), p_a, sphere)

    def _move_similarly(
        self, d: Sequence[Vector], dp: Sequence[Sequence[float]], c: Vector, v: Vector, p_a: Array
    ) -> Array | None:
        """`move` for G = S(w) + s I in closed form; None if a direction may have to be damped.

        With H = sum d d^T and T = sum d dp^T, the normal equations are (tr(H) I - H) w = vee(T) and
        tr(H) s = tr(T).
        """
        hxx, hxy, hxz, hyy, hyz, hzz = gram(d)
        (txx, txy, txz), (tyx, tyy, tyz), (tzx, tzy, tzz) = products(d, dp)
        M = hyy + hzz, -hxy, -hxz, hxx + hzz, -hyz, hxx + hyy
        trace = hxx + hyy + hzz
        tips: list[Vector] = [(x - c[0], y - c[1], z - c[2]) for x, y, z in p_a.tolist()]
        if not all(self._is_firm(M, trace, x) for x in tips):
            return None
        wx, wy, wz = times(inverse(M), (tyz - tzy, tzx - txz, txy - tyx))
        s = (txx + tyy + tzz) / trace if self._scales else 0.0
        norm = sqrt(wx * wx + wy * wy + wz * wz + s * s)
        if norm > _STEP:
            wx, wy, wz, s = (_STEP / norm * x for x in (wx, wy, wz, s))
        # p' - p = v + G ((p' + p) / 2 - c), solved for y = p' - p: k y - h x y = u with h = w / 2, k = 1 - s / 2
        hx, hy, hz, k = 0.5 * wx, 0.5 * wy, 0.5 * wz, 1.0 - 0.5 * s
        h2 = hx * hx + hy * hy + hz * hz
        after = []
        for x, y, z in tips:
            ux, uy, uz = (
                v[0] + wy * z - wz * y + s * x,
                v[1] + wz * x - wx * z + s * y,
                v[2] + wx * y - wy * x + s * z,
            )
            along, q = (hx * ux + hy * uy + hz * uz) / k, 1.0 / (k * k + h2)
            after.append(
                (
                    c[0] + x + q * (k * ux + hy * uz - hz * uy + along * hx),
                    c[1] + y + q * (k * uy + hz * ux - hx * uz + along * hy),
                    c[2] + z + q * (k * uz + hx * uy - hy * ux + along * hz),
                )
            )
        return np.array(after)

    def _is_firm(self, M: Symmetric, trace: float, tip: Vector) -> bool:
        """Whether no rotation w is damped for a robotic tip at x from c: lam >= |w x x|^2 / limit^2 for all."""
        # |w x x|^2 = w^T (x.x I - x x^T) w, and its share is subtracted from M. If the rest is positive, so is
        # its trace, 2 (tr(H) - x.x / limit^2): then the scale isn't damped either.
        (x, y, z), k = tip, self.share
        xx, xy, xz, yy, yz, zz = M
        N = (
            *(xx - k * (y * y + z * z), xy + k * x * y, xz + k * x * z),
            *(yy - k * (x * x + z * z), yz + k * y * z, zz - k * (x * x + y * y)),
        )
        return is_above(N, 2.0 * FIRM * trace)

    def _move_generally(self, mid: Array, dp: Array, c: Array, v: Array, p_a: Array, sphere: Array) -> Array:
        """`move` for any deformation, with damping and psi."""
        A, lam, W, inverse = self._decompose(mid - c, p_a - c)
        xi = W @ (inverse * (W.T @ (A @ dp.ravel())))  # (3), A^+ dp_h
        if self._psi is not Psi.NONE:
            xi = xi + self._null_motion(W[:, lam <= _null_below(lam[-1])], xi, v, sphere[:3] - c, float(sphere[3]))
        norm = sqrt(xi @ xi)
        if norm > _STEP:
            xi *= _STEP / norm
        G = (xi @ self._flat).reshape(3, 3)
        # p' - p = v + G ((p' + p) / 2 - c), solved for p' - p
        x = p_a - c
        return cast(Array, p_a + (v + x @ G.T) @ _inverse(_I - 0.5 * G).T)

    def noise_gain(self, p_h: Array, p_a: Array) -> tuple[float, float]:
        """The rms motion of the worst robotic tip divided by the fingertips' rms noise: damped, undamped.

        It is |K|_F / sqrt(3) of the matrix K in dp_a = K dp_h, for noise that is independent in every coordinate.
        """
        n, c = len(p_h), p_h.mean(axis=0)
        A, lam, W, damped = self._decompose(p_h - c, p_a - c)
        null = _null_below(lam[-1])
        undamped = np.array([1.0 / x if x > null else 0.0 for x in lam.tolist()])
        mean = np.tile(_I, n) / n
        gains: list[float] = []
        for share in (damped, undamped):
            X = (W * share) @ W.T @ A
            gains.append(max(float(np.linalg.norm(mean + self._effect(p - c) @ X)) for p in p_a) / sqrt(3.0))
        return gains[0], gains[1]

    def _decompose(self, d: Array, x: Array) -> tuple[Array, Array, Array, Array]:
        """A^T (k, 3 n_h) of (2) about c; eigenvalues, eigenvectors (k, k), damped inverses of A^T A."""
        k = len(self._B)
        A = (d @ self._Bt).reshape(k, -1)
        lam, W = np.linalg.eigh(A @ A.T)
        # Metres at the robotic tips for one unit along each direction; the largest of all tips counts.
        E = (W.T @ (x @ self._Bt).reshape(k, -1)).reshape(k, -1, 3)
        reach2 = (E * E).sum(axis=2).max(axis=1)
        # gain^2 = reach2 / lam, and the factor min(1, limit^2 / gain^2) on 1 / lam
        null, bound = _null_below(lam[-1]), (reach2 / self._limit2).tolist()
        inverse = np.array([1.0 / max(x, low) if x > null else 0.0 for x, low in zip(lam.tolist(), bound, strict=True)])
        return A, lam, W, inverse

    def _effect(self, x: Array) -> Array:
        """The motion (3, k) of a point at x from c, for one unit of each parameter."""
        return (self._B @ x).T

    def _null_motion(self, Z: Array, xi: Array, v: Array, o: Array, r: float) -> Array:
        """N_A psi (k,), which makes |do|, r |dPhi| (and, for the minimum norm, r |ds|) about o smallest."""
        scale = np.full(len(xi), r)
        if self._psi is Psi.MAXIMISE_SCALE:
            scale[self._rotations :] = 0.0
        F = self._effect(o)  # do about o = v + F xi
        rows = np.concatenate([F, np.diag(scale)])
        rest = rows @ xi
        rest[:3] += v
        return cast(Array, Z @ np.linalg.lstsq(rows @ Z, -rest, rcond=1e-9)[0])


class Similarity:
    """The finite similarity that takes `reference` (n, 3) to present points, in the least-squares sense.

    The rotation is the R with the largest tr(R^T K), K = sum b a^T, where a and b are the points about their
    centroids. If the points are nearly on a line, the rotation about the line is ill-defined and would jump. There
    it is drawn toward the identity, continuously, so that any number of points can be used.
    """

    def __init__(self, reference: Array, rigid: bool, turns: bool = True) -> None:
        """Args:
        reference: (n, 3) points before.
        rigid: without a scale.
        turns: False: the rotation is found, and not carried on.
        """
        points = reference.tolist()
        self.c0 = x0, y0, z0 = mean(points)
        self.from_centre = [(x - x0, y - y0, z - z0) for x, y, z in points]
        xx, _, _, yy, _, zz = gram(self.from_centre)
        self.a2 = xx + yy + zz
        self._rigid, self._turns = rigid, turns

    def carry(self, points: Array, p_a: Array) -> Array:
        """Moves robotic points p_a (m, 3) by the similarity that takes `reference` to `points` (n, 3)."""
        present = points.tolist()
        x1, y1, z1 = mean(present)
        K = products(present, self.from_centre)  # the centroid of a is zero, so the centroid of b may be anything
        R, first = _firm_rotation(K) or _any_rotation(K)
        u, v, w = R if self._turns else _SAME
        scale = 1.0 if self._rigid or first == 0.0 else max(first / self.a2, 0.0)
        x0, y0, z0 = self.c0
        from_centre = [(x - x0, y - y0, z - z0) for x, y, z in p_a.tolist()]
        return np.array([(x1 + scale * dot(u, x), y1 + scale * dot(v, x), z1 + scale * dot(w, x)) for x in from_centre])


def _firm_rotation(K: Rows) -> tuple[Rows, float] | None:
    """The rotation R with the largest f = tr(R^T K), and f; None if the points may be nearly on a line.

    K = R P with P symmetric and tr P = f. In terms of K's singular values, the last signed by its determinant,
    f = s_1 + s_2 + s_3. This is the largest root of p(f) = (f^2 - |K|^2)^2 - 8 f det K - 4 |cof K|^2. From the
    Cayley-Hamilton theorem for P follows R = ((f^2 - g) K + f cof K - K K^T K) / (f g - det K), where
    g = s_1 s_2 + s_2 s_3 + s_3 s_1.
    """
    (a, b, c), (d, e, f), (g, h, i) = K
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g  # the cofactors
    D, E, F = c * h - b * i, a * i - c * g, b * g - a * h
    G, H, L = b * f - c * e, c * d - a * f, a * e - b * d
    det = a * A + b * B + c * C
    xx, xy, xz, yy, yz, zz = gram(((a, d, g), (b, e, h), (c, f, i)))  # K K^T
    K2, C2 = xx + yy + zz, A * A + B * B + C * C + D * D + E * E + F * F + G * G + H * H + L * L
    # K is firm if f >= (1 + _TWIST) s_1. As s_1 <= |K|, this holds if p is negative at (1 + _TWIST) |K|.
    low = (1.0 + _TWIST) * (1.0 + _TWIST)
    above = (low - 1.0) * K2
    if K2 < _POINT * _POINT or above * above >= 8.0 * sqrt(low * K2) * det + 4.0 * C2:
        return None
    trace = sqrt(K2 + 2.0 * sqrt(C2))  # exact for points in a plane
    for _ in range(_NEWTON):
        gap = trace * trace - K2
        trace -= (gap * gap - 8.0 * trace * det - 4.0 * C2) / (4.0 * trace * gap - 8.0 * det)
    second = 0.5 * (trace * trace - K2)
    k = 1.0 / (trace * second - det)
    diagonal = trace * trace - second
    xx, yy, zz = diagonal - xx, diagonal - yy, diagonal - zz
    rotation = (
        (
            k * (xx * a - xy * d - xz * g + trace * A),
            k * (xx * b - xy * e - xz * h + trace * B),
            k * (xx * c - xy * f - xz * i + trace * C),
        ),
        (
            k * (yy * d - xy * a - yz * g + trace * D),
            k * (yy * e - xy * b - yz * h + trace * E),
            k * (yy * f - xy * c - yz * i + trace * F),
        ),
        (
            k * (zz * g - xz * a - yz * d + trace * G),
            k * (zz * h - xz * b - yz * e + trace * H),
            k * (zz * i - xz * c - yz * f + trace * L),
        ),
    )
    return rotation, trace


def _any_rotation(K: Rows) -> tuple[Rows, float]:
    """The same as `_firm_rotation`, from Horn's quaternion (1987), drawn toward the identity where ill-defined.

    Returns the identity and zero if all points of one side coincide.
    """
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = K
    N = np.array(
        [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, yy - xx - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, zz - xx - yy],
        ]
    )
    lam, Q = np.linalg.eigh(N)
    # The two largest are s_1 + s_2 + s_3 and s_1 - s_2 - s_3. Their gap tells how well the rotation is defined.
    second, first = lam[2:].tolist()
    if first + second < _POINT:
        return _SAME, 0.0
    lack = _TWIST - (first - second) / (first + second)
    if lack > 0.0:
        Q = np.linalg.eigh(N + 0.5 * lack * (first + second) * _IDENTITY)[1]
        first = float(Q[:, 3] @ N @ Q[:, 3])
    u, v, w = matrix(Q[:, 3].tolist()).tolist()
    return (tuple(u), tuple(v), tuple(w)), first


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
    """The bound up to which eigenvalues of A^T A count as zero. All do if the points coincide."""
    return _NULL * largest if largest > _POINT else np.inf
