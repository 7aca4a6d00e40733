"""How fast a limb's own motion may close the distance to something that moves as it likes within a bound.

A limb that is too near may go away. For this its motion must not close the distance, wherever the other may be by
then. Let X be the limb's axis at q_j and Y the other's where it was seen, D their distance, n the unit vector from Y's
nearest point to X's. Until the limb has left the piece behind q_j, their points have moved: together by r at most, and
along n no nearer than to G, so that n . (x - y) >= G for all of both. G is g_j of `srl.control.shared.approach`, (1)
and (3), with the radii. For the nearest points x', y' by then, D' apart along n':

    n . (x' - y') >= G, so n' . n >= G / D'
    n . (x' - y') >= D - r, so n' . n >= (D - r) / D', and n' . (x' - y') = D' <= n' . (x - y) + r for the points that
    were nearest, so n' . n >= (D' - r) / D: by the one for D' <= D, by the other beyond, n' . n >= 1 - r / D

They touch where D' <= S, the sum of both radii and of what is always kept. So a touch is only possible with n' within

    cos phi = max(G / S where G >= 0, 1 - r / D where D >= r, -1)                                                    (4)

of n, and impossible with G > S. asin(r / D) would do for two points, and isn't enough for segments: the normal of two
that tilt turns farther.

The limb touches with some point between its ends x_f, whose velocity is between theirs. So with v_f = J_f(q_j) q' the
distance closes by at most

    max_f -|v_f| cos(min(angle(n, v_f) + phi, pi)) + sum_ik W_ik |q'_i| (|dq_k| + sigma_k) + sum_i R_i spread_i      (5)

where the second term is what v_f changes between q_j and where the limb is (W, sigma as in
`srl.control.shared.approach`), and spread_i is by how much a joint's velocity may be beside q'_i. A limb that brakes
along q' has a share of q' that falls to 0, and may have the whole spread: of the first two terms counts what is above
0. How fast the limb's error changes within sigma isn't known, and not in (5): a servo that swings about its command by
less than `tracking` isn't seen here.
"""

from __future__ import annotations

import numpy as np

from srl.runtime.contracts.signals import Array

NONE = -np.inf  # m/s: nothing can touch


def contact_cone(gap: Array, apart: Array, reach: Array, touching: Array | float) -> Array:
    """cos phi of equation (4), -1 to 1; more than 1: they can't touch.

    Args:
        gap: G, m.
        apart: D, m, of the axes.
        reach: r, m; all of one shape.
        touching: S, m.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.where(reach < apart, 1.0 - reach / apart, -1.0)  # what isn't a number: -1
    return np.maximum(np.where(gap >= 0.0, gap / touching, -1.0), turned)


def closing(velocity: Array, normal: Array, cosine: Array) -> Array:
    """The first term of equation (5), m/s, of the worse end; `NONE` where they can't touch.

    Args:
        velocity: v_f, (3, ..., f) m/s.
        normal: n, (3, ...).
        cosine: cos phi, (...), of `contact_cone`.
    """
    size = np.sqrt(np.add.reduce(velocity * velocity, axis=0))
    along = np.add.reduce(velocity * normal[..., None], axis=0)
    side = np.sqrt(np.maximum(size * size - along * along, 0.0))
    c = np.minimum(cosine, 1.0)[..., None]
    s = np.sqrt(1.0 - c * c)
    # Beyond angle + phi = pi the other may be straight ahead.
    away = np.where(along >= -size * c, along * c - side * s, -size)
    worst = (-away).max(axis=-1)
    return np.where(cosine > 1.0, NONE, worst)
