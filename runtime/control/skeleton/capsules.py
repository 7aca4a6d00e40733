"""Distances of capsules: of the segments on their axes, less both radii."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.contracts.signals import Array

_LEAST = 1e-12  # m^2: shorter axes are points, more parallel ones have no crossing


class Nearest(NamedTuple):
    """The nearest points of pairs of segments; (..., k) pairs.

    Attributes:
        distance: (..., k) m, of the axes.
        on_first, on_second: (..., k, 3) m.
    """

    distance: Array
    on_first: Array
    on_second: Array


def nearest(a: Array, b: Array, c: Array, d: Array) -> Nearest:
    """The nearest points of the segments a-b and c-d, each (..., k, 3) m.

    Where axes are parallel the points aren't unique; one pair of them is given. Segments may have no length.
    Source: Ericson, Real-Time Collision Detection (2005), 5.1.9: the unclamped minimum, clamped to one segment, then
    to the other, and back.
    """
    u, v, r = b - a, d - c, a - c
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    ur, vr = _dot(u, r), _dot(v, r)
    uu, vv = np.maximum(uu, _LEAST), np.maximum(vv, _LEAST)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, _LEAST * _LEAST), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    on_first, on_second = a + s[..., None] * u, c + t[..., None] * v
    gap = on_second - on_first
    return Nearest(np.sqrt(_dot(gap, gap)), on_first, on_second)


def _dot(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product
