"""How near two bodies may come while one of them brakes and the other moves as it likes within an acceleration.

One is a limb whose braking motion is known in samples q_0 to q_m; the limb is on its way to q_j until u_j at the
latest (`srl.runtime.contracts.clearance.Braking`). The other was seen a seconds ago. It is the hull of balls round a
few points, its ends (a capsule has two), and end e accelerates by at most a_e. For one pair of convex shapes, q_j held:

    d(q_j, s) >= g_j(s) = min_e  H_je - w_je (a + s) - a_e (a + s)^2 / 2                                            (1)

n_j is the unit vector from the other's nearest point to the limb's, H_je the height of end e under the plane through
the limb's nearest point that is normal to n_j, less the radii, and w_je >= 0 the speed of the end along n_j. The limb
lies beyond that plane. An end has come nearer to it by no more than (1) says; a point between two ends, in a fixed
proportion p of them, has the height p H_1 + (1 - p) H_2 and comes nearer by no more than the same mixture. So the
lesser end counts, and a segment whose fast end is far from the limb counts for what its near end can do.

Between two samples the limb is at some q that it reaches over a travel of t from q_j and of L - t to q_j+1, where L =
sum_i R_i |dq_i| bounds the travel of each of its points (R_i: of a point of this shape about, or along, joint i). So

    d(q, s) >= max(g_j(s) - t, g_j+1(s) - (L - t)) >= (g_j(s) + g_j+1(s) - L) / 2                                    (2)

g falls with s, so s = u_j+1 covers the whole piece. What is left over beyond C + Z is the margin of the piece; the
motion is clear if no pair has a negative one on any piece. After the last sample the limb rests. In Z_r is what the
limb may be beside its commands, sum_i R_i sigma_i.

R_i is the farthest that any posture reaches. The posture's own levers are less. Let the limb's shape be the hull of
balls round its ends x_f (a link has two), J_f their Jacobian at q_j, h_jf the height of x_f over the limb's nearest
point along n_j, and c_jfi = n_j . J_fi. A limb that is off by delta from q_j lies beyond a plane lower by at most

    - min_f (h_jf + sum_i c_jfi delta_i) + rho(|delta|),    rho(u) = 1/2 sum_ik W_ik u_i u_k                         (3)

with W_ik >= |d^2 x_f / dq_i dq_k| in every posture. For i <= k along the chain that is |e_i x (e_k x (x_f - p_k))|,
at most R_k, where both turn, at most 1 where k slides, and 0 where i slides. On a piece delta_i is between 0 and dq_i
(seen from q_j+1: between -dq_i and 0), and sigma_i to either side. Of the travel then counts, joint by joint, what the
greater of the two levers takes, and of sigma what it takes at each of both samples, in the mean:

    L' = sum_i max(a_i, b_i),  a_i = max_f max(0, -c_jfi dq_i),  b_i = max_f max(0, c_j+1,fi dq_i)
    Z_r' = 1/2 sum_(j, j+1) - min_f (h_f - sum_i |c_fi| sigma_i) + rho(|dq| + sigma)

In rho the greater |J_fk| of both samples do in place of R_k, with a third order, (sum_l u_l) sum_ik R_k u_i u_k / 6.

Both (2) with R and (2) with L' and Z_r' hold, so the greater margin counts.

Sources: ISO/TS 15066:2016, 5.5.4 (S_h + S_r + S_s + C + Z_d + Z_r); Marvel and Norcross, Implementing speed and
separation monitoring in collaborative robot workcells, Robotics and Computer-Integrated Manufacturing 44 (2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from srl.runtime.contracts.signals import Array

STEADY = 1e-9  # m: a distance that shrinks by less doesn't shrink


@dataclass(frozen=True, slots=True)
class Separation:
    """What is needed between the two.

    Attributes:
        acceleration: a_e, m/s^2; one number, or (k, e) one for each pair and end.
        least: C, m: what is always kept.
        uncertainty: Z_d, m: by which the two may be nearer than they were seen; one number, or (k,).
    """

    acceleration: float | Array
    least: float
    uncertainty: float | Array


def travels(path: Array, reach: Array) -> Array:
    """L of each piece and pair (m - 1, k), m. path: (m, n) rad or m; reach: (n, k) m for each rad or m."""
    travelled: Array = np.abs(path[1:] - path[:-1]) @ reach
    return travelled


def gaps(height: Array, speed: Array, until: Array, age: float | Array, needed: Separation) -> tuple[Array, Array]:
    """g_j and g_j+1 of equation (1) at u_j+1, for each piece, (m - 1, k) m each. Arguments as `margins`."""
    t = (until[1:, None] + age)[..., None]
    fallen = (0.5 * needed.acceleration) * (t * t)
    return _lesser(height[:-1] - speed[:-1] * t - fallen), _lesser(height[1:] - speed[1:] * t - fallen)


def margins(
    height: Array, speed: Array, travel: Array, until: Array, age: float | Array, slack: Array, needed: Separation
) -> Array:
    """The margins of equation (2), (m - 1, k) m.

    Args:
        height: H_je, (m, k, e) m.
        speed: w_je, (m, k, e) m/s.
        travel: L or L', (m - 1, k) m.
        until: u_j, (m,) s.
        age: a, s; one number, or (k,) one for each pair.
        slack: Z_r, (k,) m, or Z_r', (m - 1, k): by which the limb's shape may be beside its commanded place.
        needed: C, Z_d and a_e.
    """
    before, after = gaps(height, speed, until, age, needed)
    return 0.5 * (before + after - travel) - (needed.least + needed.uncertainty + slack)


class Lowered(NamedTuple):
    """What equation (3) says of each piece and pair, (m - 1, k) m each.

    Attributes:
        travel: L'.
        slack: Z_r'.
        most: by how much lower than the plane of q_j the limb may be anywhere on the piece.
    """

    travel: Array
    slack: Array
    most: Array


def by_levers(lever: Array, above: Array, path: Array, slack: Array, rho: Array) -> Lowered:
    """L' and Z_r' of equation (3).

    Args:
        lever: c_jfi, (m, k, f, n) m for each rad or m.
        above: h_jf, (m, k, f) m.
        path: q_j, (m, n) rad or m.
        slack: sigma, (n,) rad or m.
        rho: of each piece, (m - 1, k) m, of |dq| + sigma.
    """
    way = (path[1:] - path[:-1])[:, None, None]
    a = np.maximum(-_lesser((lever[:-1] * way).swapaxes(2, 3)), 0.0)
    b = np.maximum(_greater((lever[1:] * way).swapaxes(2, 3)), 0.0)
    low = _lesser(above - np.abs(lever) @ slack)
    return Lowered(np.maximum(a, b).sum(axis=-1), rho - 0.5 * (low[:-1] + low[1:]), a.sum(axis=-1) + rho - low[:-1])


def reserve(
    height: Array, speed: Array, travel: Array, last: float, age: float | Array, slack: Array, needed: Separation
) -> Array:
    """A bound below what each pair keeps more than it needs, (k,) m, from the first sample alone.

    It bounds the distance, as `margins` does, and may lie above that, which takes the mean of both ends.

    By (1) the pair is g_0(u_m) apart at the end of the motion at least, had the limb stayed; it goes no farther than
    the sum of L. A pair with a bound above 0 needs no closer look.

    Args:
        height, speed: H_0e, w_0e, (k, e).
        travel: L, (m - 1, k) m.
        last: u_m, s.
        age, slack, needed: as `margins`.
    """
    t = np.asarray(age + last)[..., None]
    g = _lesser(height - speed * t - (0.5 * needed.acceleration) * (t * t))
    bound: Array = g - travel.sum(axis=0) - (needed.least + needed.uncertainty + slack)
    return bound


def _lesser(ends: Array) -> Array:
    """The least over the last axis; `min` takes ten times as long over an axis of two."""
    return reduce(np.minimum, [ends[..., e] for e in range(ends.shape[-1])])


def _greater(ends: Array) -> Array:
    return reduce(np.maximum, [ends[..., e] for e in range(ends.shape[-1])])


def is_clear(margin: Array, distance: Array, closing: Array, creep: float) -> bool:
    """Whether a motion may be carried out.

    A pair that is too near lets the limb go on only if it leaves: its distance doesn't shrink, were the other at rest,
    and the limb's own motion doesn't close it at over `creep`, wherever the other may be.

    Args:
        margin: (m - 1, k), of `margins`.
        distance: (m, k) m.
        closing: (k,) m/s: by which the limb's motion alone may close the distance, whatever the other does
            (`srl.control.shared.leaving`).
        creep: m/s.
    """
    least = margin.min(axis=0)
    if np.isnan(least).any():
        return False
    near = least < 0.0
    if not near.any():
        return True
    if not (closing[near] <= creep).all():
        return False
    left = distance[:, near]
    return bool((left[1:] - left[:-1] >= -STEADY).all())
