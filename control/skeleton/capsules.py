"""Distances of capsules: of the segments on their axes, less both radii."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

TOUCHING: Final = 1e-9  # m: axes that are nearer have no direction from the one to the other
_LEAST = 1e-12  # m^2: shorter axes are points, more parallel ones have no crossing

Indices = NDArray[np.intp]


class Nearest(NamedTuple):
    """The nearest points of k pairs of segments and links. The coordinates come first: long rows are computed quickly.

    Attributes:
        distance: (..., k) m, of the axes.
        normal: (3, ..., k) from the segment's point to the link's, of length 1; shorter where they are TOUCHING.
        on_segment, on_link: (..., k) 0 to 1, where on its axis the point is.
        along: (..., k) m, the segment's axis along the normal.
    """

    distance: Array
    normal: Array
    on_segment: Array
    on_link: Array
    along: Array


def nearest(ends: Array, segments: Indices, nodes: Array, links: Indices) -> Nearest:
    """The nearest points of pairs of a segment and a link of a chain.

    Where axes are parallel the points aren't unique; one pair of them is given. Both may have no length.
    Source: Ericson, Real-Time Collision Detection (2005), 5.1.9: the unclamped minimum, clamped to one segment, then
    to the other, and back.

    Args:
        ends: (s, 2, 3) m, of the segments.
        segments: (k,) which segment.
        nodes: (..., n, 3) m, of the chain, in as many configurations as there are.
        links: (k,) which link: from this node to the next.
    """
    a, b = ends.transpose(1, 2, 0)
    c = nodes.transpose(nodes.ndim - 1, *range(nodes.ndim - 1))
    u, v = b - a, c[..., 1:] - c[..., :-1]
    uu, vv = np.maximum(_dot(u, u), _LEAST).take(segments), np.maximum(_dot(v, v), _LEAST).take(links, axis=-1)
    each = (slice(None), *(None,) * (nodes.ndim - 2))  # the body's are the same in every configuration
    u, v = u.take(segments, axis=1)[each], v.take(links, axis=-1)
    r = a.take(segments, axis=1)[each] - c.take(links, axis=-1)
    uv, ur, vr = _dot(u, v), _dot(u, r), _dot(v, r)
    s = _clamped((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, _LEAST * _LEAST))
    t = _clamped((uv * s + vr) / vv)
    s = _clamped((uv * t - ur) / uu)
    gap = t * v - s * u - r
    distance = np.sqrt(_dot(gap, gap))
    gap /= np.maximum(distance, TOUCHING)
    return Nearest(distance, gap, s, t, _dot(u, gap))


def between(values: Array, index: Indices, share: Array) -> Array:
    """What is at these shares of the way between both values.

    Args:
        values: (s, 2, 3), at the ends.
        index: (k,) which two.
        share: (k,) 0 to 1.

    Returns:
        (3, k).
    """
    first, last = values.transpose(1, 2, 0).take(index, axis=2)
    mixed: Array = first + share * (last - first)
    return mixed


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.add.reduce(a * b, axis=0)
    return product


def _clamped(share: Array) -> Array:
    return np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
