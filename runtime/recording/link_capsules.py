"""The shapes of a robot's links as capsules, for pictures that draw nothing else.

A box or a disk is filled with capsules that lie side by side, so that its outline is right within their radius.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.linkage import Linkage, Solid
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import CAPSULE

_MOST: Final = 6  # side by side


def link_capsules(linkage: Linkage) -> tuple[NDArray[np.int64], Array]:
    """(k,) the link of each capsule, and (k, 8) terms.CAPSULE in that link's frame, m; no distance."""
    numbers: list[int] = []
    rows: list[Array] = []
    for number, link in enumerate(linkage.links):
        for solid in link.solids:
            made = _capsules(solid)
            numbers += [number] * len(made)
            rows += list(made)
    return np.array(numbers, np.int64), np.array(rows).reshape(-1, len(CAPSULE))


def _capsules(solid: Solid) -> Array:
    """(n, 8) in the link's frame."""
    T = homogeneous(np.array(solid.pose))
    made = np.array([(*a, *b, radius, np.nan) for a, b, radius in _upright(solid)])
    for at in (0, 3):
        made[:, at : at + 3] = made[:, at : at + 3] @ T[:3, :3].T + T[:3, 3]
    return made


def _upright(solid: Solid) -> list[tuple[Array, Array, float]]:
    """Two ends and radius of each, in the solid's own frame."""
    if solid.kind == "sphere":
        return [(np.zeros(3), np.zeros(3), solid.size[0])]
    if solid.kind == "capsule":
        radius, half = solid.size
        return [_along(2, half, (0, 0.0), radius)]
    if solid.kind == "cylinder":
        radius, half = solid.size
        if half >= radius:
            return [_along(2, half - radius, (0, 0.0), radius)]
        # A disk: capsules across it, each as long as the chord.
        places = _places(radius, half)
        return [_along(0, max(sqrt(radius**2 - y**2) - half, 0.0), (1, y), half) for y in places]
    order = np.argsort(solid.size)
    thin, middle, long = (solid.size[i] for i in order)
    return [_along(int(order[2]), long - thin, (int(order[1]), y), thin) for y in _places(middle, thin)]


def _places(half: float, radius: float) -> list[float]:
    """The middles of capsules that fill a width of twice `half`."""
    count = min(ceil(half / max(radius, 1e-6)), _MOST)
    return np.linspace(-1.0, 1.0, count).dot(half - radius).tolist() if count > 1 else [0.0]


def _along(axis: int, half: float, beside: tuple[int, float], radius: float) -> tuple[Array, Array, float]:
    ends = np.zeros((2, 3))
    ends[:, beside[0]] = beside[1]
    ends[0, axis], ends[1, axis] = -half, half
    return ends[0], ends[1], radius
