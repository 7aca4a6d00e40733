"""How near two bodies may come while one of them brakes and the other moves as it likes within an acceleration.

One is a limb whose braking motion is known in samples q_0 to q_m; the limb is on its way to q_j until u_j at the latest
(`runtime.contracts.clearance.Braking`). The other was seen a seconds ago, and each point of it accelerates by at most
a_H. For one pair of convex shapes, with q_j held and seen from now on, s seconds later:

    d(q_j, s) >= d_j - h_j(s),   h_j(s) = w_j (a + s) + a_H (a + s)^2 / 2                                           (1)

where w_j >= 0 bounds the speed of the other's points along n_j, the unit vector from its nearest point to the limb's:
the plane through the limb's nearest point that is normal to n_j has the limb on one side, and no point of the other has
come nearer to it by more than h_j.

Between two samples the limb is at some q that it reaches over a travel of t from q_j and of L - t to q_j+1, where L =
sum_i R_i |dq_i| bounds the travel of each of its points (R_i: of a point of this shape about, or along, joint i). So

    d(q, s) >= max(d_j - h_j(s) - t, d_j+1 - h_j+1(s) - (L - t)) >= (d_j - h_j(s) + d_j+1 - h_j+1(s) - L) / 2      (2)

h grows with s, so s = u_j+1 covers the whole piece. This is the design's d - h - L/2 >= C + Z, with the mean of both
ends in place of the lesser. What is left over beyond C + Z is the margin of the piece; the motion is clear if no pair
has a negative one on any piece. After the last sample the limb rests.

Sources: ISO/TS 15066:2016, 5.5.4 (S_h + S_r + S_s + C + Z_d + Z_r); Marvel and Norcross, Implementing speed and
separation monitoring in collaborative robot workcells, Robotics and Computer-Integrated Manufacturing 44 (2017).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.signals import Array

STEADY = 1e-9  # m: a distance that shrinks by less doesn't shrink


@dataclass(frozen=True, slots=True)
class Separation:
    """What is needed between the two.

    Attributes:
        acceleration: a_H, m/s^2; one number, or (k,) one a pair.
        least: C, m: what is always kept.
        uncertainty: Z_d, m: by which the other may be beside where it was seen.
    """

    acceleration: float | Array
    least: float
    uncertainty: float


def travels(path: Array, reach: Array) -> Array:
    """L of each piece and pair (m - 1, k), m. path: (m, n) rad or m; reach: (n, k) m for each rad or m."""
    travelled: Array = np.abs(np.diff(path, axis=0)) @ reach
    return travelled


def margins(
    distance: Array, speed: Array, travel: Array, until: Array, age: float, slack: Array, needed: Separation
) -> Array:
    """The margins of equation (2), (m - 1, k) m.

    Args:
        distance: d_j, (m, k) m.
        speed: w_j, (m, k) m/s.
        travel: L, (m - 1, k) m.
        until: u_j, (m,) s.
        age: a, s.
        slack: Z_r, (k,) m: by which the limb's shape may be beside its commanded place.
        needed: C, Z_d and a_H.
    """
    t = (age + until[1:])[:, None]
    h = 0.5 * (speed[:-1] + speed[1:]) * t + (0.5 * needed.acceleration) * t * t
    return 0.5 * (distance[:-1] + distance[1:] - travel) - h - (needed.least + needed.uncertainty + slack)


def is_clear(margin: Array, distance: Array, crawl: NDArray[np.bool_]) -> bool:
    """Whether a motion may be carried out.

    Args:
        margin: (m - 1, k), of `margins`.
        distance: (m, k) m.
        crawl: (k,) whether the limb's shape is so slow that it may leave what is too near.
    """
    near = margin.min(axis=0) < 0.0
    if not near.any():
        return True
    if not crawl[near].all():
        return False
    return bool((np.diff(distance[:, near], axis=0) >= -STEADY).all())
