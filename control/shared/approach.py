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
motion is clear if no pair has a negative one on any piece. After the last sample the limb rests.

Sources: ISO/TS 15066:2016, 5.5.4 (S_h + S_r + S_s + C + Z_d + Z_r); Marvel and Norcross, Implementing speed and
separation monitoring in collaborative robot workcells, Robotics and Computer-Integrated Manufacturing 44 (2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

STEADY = 1e-9  # m: a distance that shrinks by less doesn't shrink


@dataclass(frozen=True, slots=True)
class Separation:
    """What is needed between the two.

    Attributes:
        acceleration: a_e, m/s^2; one number, or (k, e) one for each pair and end.
        least: C, m: what is always kept.
        uncertainty: Z_d, m: by which the other may be beside where it was seen.
    """

    acceleration: float | Array
    least: float
    uncertainty: float


def travels(path: Array, reach: Array) -> Array:
    """L of each piece and pair (m - 1, k), m. path: (m, n) rad or m; reach: (n, k) m for each rad or m."""
    travelled: Array = np.abs(path[1:] - path[:-1]) @ reach
    return travelled


def margins(
    height: Array, speed: Array, travel: Array, until: Array, age: float | Array, slack: Array, needed: Separation
) -> Array:
    """The margins of equation (2), (m - 1, k) m.

    Args:
        height: H_je, (m, k, e) m.
        speed: w_je, (m, k, e) m/s.
        travel: L, (m - 1, k) m.
        until: u_j, (m,) s.
        age: a, s; one number, or (k,) one for each pair.
        slack: Z_r, (k,) m: by which the limb's shape may be beside its commanded place.
        needed: C, Z_d and a_e.
    """
    t = (until[1:, None] + age)[..., None]
    fallen = (0.5 * needed.acceleration) * (t * t)
    before = _lesser(height[:-1] - speed[:-1] * t - fallen)
    after = _lesser(height[1:] - speed[1:] * t - fallen)
    return 0.5 * (before + after - travel) - (needed.least + needed.uncertainty + slack)


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


def is_clear(margin: Array, distance: Array, crawl: NDArray[np.bool_]) -> bool:
    """Whether a motion may be carried out.

    Args:
        margin: (m - 1, k), of `margins`.
        distance: (m, k) m.
        crawl: (k,) whether the limb's shape is so slow that it may leave what is too near.
    """
    least = margin.min(axis=0)
    if np.isnan(least).any():
        return False
    near = least < 0.0
    if not near.any():
        return True
    if not crawl[near].all():
        return False
    left = distance[:, near]
    return bool((left[1:] - left[:-1] >= -STEADY).all())
