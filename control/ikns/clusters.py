"""Which samples belong to which calibration point: the paper's variant of k-means on the hand's positions."""

from __future__ import annotations

from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

Indices = NDArray[np.intp]

_ROUNDS: Final = 100  # of k-means; the assignment is unchanged long before
_WINDOW: Final = 0.1  # s, over which the hand's velocity is a fitted line's: differences of noisy samples are too large
_BLOCK: Final = 1000  # samples


def hand_speed(times: Array, hand: Array) -> Array:
    """Returns (T,) m/s, the slope of hand (T, 3) m over the tenth of a second around each of times (T,) s, ascending.

    Not finite where fewer than three finite samples lie in it.
    """
    speed = np.full(len(times), np.nan)
    for begin in range(0, len(times), _BLOCK):  # sums over hours would lose the digits of a tenth of a second
        end = min(begin + _BLOCK, len(times))
        low = int(np.searchsorted(times, times[begin] - _WINDOW))
        high = int(np.searchsorted(times, times[end - 1] + _WINDOW))
        speed[begin:end] = _block_speed(times[low:high], hand[low:high])[begin - low : end - low]
    return speed


def _block_speed(times: Array, hand: Array) -> Array:
    seen = np.isfinite(hand).all(axis=1)
    t = times[seen] - times[0]
    x = hand[seen] - (hand[seen].mean(axis=0) if seen.any() else 0.0)
    first = np.searchsorted(t, times - times[0] - _WINDOW / 2 - 1e-9)
    last = np.searchsorted(t, times - times[0] + _WINDOW / 2 + 1e-9)
    n = np.maximum(last - first, 1)[:, None]

    def total(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0)])
        found: Array = sums[last] - sums[first]
        return found

    ts, xs = total(t[:, None]), total(x)
    spread = total(t[:, None] ** 2) - ts**2 / n
    fitted = ((n[:, 0] >= 3) & (spread[:, 0] > 1e-9))[:, None]
    slope = np.where(fitted, total(t[:, None] * x) - ts * xs / n, np.nan) / np.where(fitted, spread, 1.0)
    speed: Array = np.linalg.norm(slope, axis=1)
    return speed


def box_points(hand: Array, n: int, up: int) -> Array:
    """Returns (n, 3) m on the surface of the samples' bounding box: where the centroids begin.

    The box is along the frame's axes. Its 8 corners come first, then the centres of the lower and the upper face, then
    those of the other faces, then the middles of the edges: 8 <= n <= 26. `up` is the axis that points upwards.
    """
    lower, upper = hand.min(axis=0), hand.max(axis=0)
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
    signs = [np.array(s, dtype=float) for s in product((-1, 1), (-1, 1), (-1, 1))]
    for axis in (up, *(a for a in range(3) if a != up)):
        signs += [sign * np.eye(3)[axis] for sign in (-1.0, 1.0)]
    signs += [np.array(s, dtype=float) for s in product((-1, 0, 1), repeat=3) if np.count_nonzero(s) == 2]
    return middle + np.array(signs[:n]) * half


def k_means(hand: Array, centroids: Array) -> tuple[Array, Indices]:
    """Returns centroids (N, 3) and the cluster (T,) of each sample, from given centroids on.

    A centroid without samples stays where it is.
    """
    cluster = np.full(len(hand), -1, dtype=np.intp)
    for _ in range(_ROUNDS):
        nearest = ((hand[:, None] - centroids) ** 2).sum(axis=2).argmin(axis=1)
        if (nearest == cluster).all():
            break
        cluster = nearest
        centroids = _means(hand, cluster, centroids)
    return centroids, cluster


def trimmed(hand: Array, centroids: Array, cluster: Indices, radius: float) -> tuple[Array, Indices]:
    """Discards samples farther than `radius` m from their centroid, which moves to the mean of what is kept.

    Returns centroids (N, 3) and the cluster (T,) of each sample, -1 for discarded ones.
    """
    kept = cluster
    for _ in range(_ROUNDS):
        near = np.linalg.norm(hand - centroids[cluster], axis=1) <= radius
        now = np.where(near, cluster, -1)
        if (now == kept).all():
            break
        kept = now
        centroids = _means(hand[near], cluster[near], centroids)
    return centroids, kept


def _means(hand: Array, cluster: Indices, before: Array) -> Array:
    counts = np.bincount(cluster, minlength=len(before))
    sums = np.stack([np.bincount(cluster, hand[:, k], len(before)) for k in range(3)], axis=1)
    found: Array = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], before)
    return found
