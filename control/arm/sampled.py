"""Whether a joint impedance still damps in cycles as long as the profile's, free and against something stiff.

A torque is held for a cycle and is of the measurement of the cycle before: the damper acts late by one and a half
cycles. So it damps what is slow, and drives what is quick: a light joint by itself, or the limb's bounce on something
stiff. No rate is enough for whatever it may touch: Colgate and Schenkel (1997, J. Robotic Systems 14(1)) ask for more
friction in the joint than K T / 2 + D. So it is asked for what it may touch at most: `STIFF`.

The motion is that of the frictionless arm about a posture, exactly, from cycle to cycle:
M q'' = tau - C q, tau held, tau(k + 1) = -K q(k) - D q'(k).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pinocchio as pin
from scipy.linalg import expm

from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots.pinocchio_model import FLANGE

STIFF: Final = 4e4  # N/m at the flange: the edge of a table, a door frame
GROWTH: Final = 1.0  # 1/s, which any friction takes
_POSTURES: Final = 6  # beside home, anywhere within the limits
_WAYS: Final = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]]) / np.sqrt(
    [[1], [1], [1], [2], [2], [2]]
)


def growth(M: Array, C: Array, K: Array, D: Array, dt: float) -> float:
    """1/s, at which the least damped motion grows; negative: all die away.

    Args:
        M: (n, n) kg m^2, with rotors. C: (n, n) N m/rad, of what it touches.
        K, D: (n,) N m/rad, N m s/rad. dt: s.
    """
    n = len(K)
    inverse = np.linalg.inv(M)
    flow = np.zeros((3 * n, 3 * n))
    flow[:n, n : 2 * n], flow[n : 2 * n, :n], flow[n : 2 * n, 2 * n :] = np.eye(n), -inverse @ C, inverse
    step = expm(flow * dt)
    step[2 * n :] = np.hstack([-np.diag(K), -np.diag(D), np.zeros((n, n))])
    return float(np.log(np.abs(np.linalg.eigvals(step)).max()) / dt)


def cases(model: Any, home: Array, lower: Array, upper: Array, rotors: Array) -> Iterator[tuple[Array, Array]]:
    """The inertia (n, n) of several postures, and the stiffness (n, n) of what is touched there, zero for nothing."""
    data, frame = model.createData(), model.getFrameId(FLANGE)
    low = np.where(np.isfinite(lower), lower, home - 1.0)
    high = np.where(np.isfinite(upper), upper, home + 1.0)
    share = np.random.default_rng(0).random((_POSTURES, len(home)))  # the same at each check
    for q in (home, *(low + share * (high - low))):
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T + np.diag(rotors)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        yield M, np.zeros_like(M)
        for way in _WAYS @ J:
            yield M, STIFF * np.outer(way, way)
