"""Known points that fit each other in another order, too: whoever touched them so would see nothing of it."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.commissioning.calibration.frames.fit import rigid
from srl.runtime.contracts.signals import Array

NEAR: Final = 0.01  # m, twice what may be left of a point


def exchanged(points: Array) -> tuple[int, ...] | None:
    """Another order in which points (n, 3), m, have the same distances from each other; None: there is none.

    The frame would then be found turned, with nothing left. Numbers begin at 1.
    """
    n = len(points)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    i, j = np.unravel_index(int(apart.argmax()), apart.shape)
    along = (points[j] - points[i]) / max(apart[i, j], 1e-12)
    away = points - points[i]
    k = int(np.linalg.norm(away - np.outer(away @ along, along), axis=1).argmax())
    if len({int(i), int(j), k}) < 3:
        return None  # all at one place
    base = [int(i), int(j), k]
    like = (
        (np.abs(apart - apart[i, j]) < 2 * NEAR)[:, :, None]
        & (np.abs(apart - apart[i, k]) < 2 * NEAR)[:, None, :]
        & (np.abs(apart - apart[j, k]) < 2 * NEAR)[None, :, :]
    )
    for triple in np.argwhere(like).tolist():
        R, t = rigid(points[triple], points[base])
        order = np.linalg.norm((points @ R.T + t)[:, None] - points, axis=2).argmin(axis=1)
        if len(set(order.tolist())) < n or (order == np.arange(n)).all():
            continue
        R, t = rigid(points[order], points)
        if np.linalg.norm(points @ R.T + t - points[order], axis=1).max() < NEAR:
            return tuple((order + 1).tolist())
    return None
