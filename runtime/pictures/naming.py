"""Names of points on a picture, placed where they don't cover each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke

from srl.runtime.contracts.signals import Array

FONT = 7  # points
HALO = [withStroke(linewidth=2.0, foreground="white")]
LINE = {"arrowstyle": "-", "color": "0.5", "linewidth": 0.5, "shrinkA": 0.0, "shrinkB": 1.0}
NEAR, STEP, FAR = 7.0, 5.0, 62.0  # points, from a node to its name
BEAD = 4.0  # points between two places of a line that are kept free
LEAD = 12.0  # points, from which a line leads to the name
AROUND = np.deg2rad([0.0, 180.0, 90.0, -90.0, -25.0, 205.0, 25.0, 155.0, -50.0, 230.0, 50.0, 130.0])


def write_names(axis: Any, names: Sequence[str], points: Array, lines: Sequence[Array] = ()) -> None:
    """Writes each name beside its point (k, 2) of the axis: as near as nothing is covered, and within the picture.

    The axis must have its final place and limits. `lines`: polylines (n, 2) that are kept free, too.
    """
    figure = axis.figure
    dot = figure.dpi / 72.0  # pixels a point
    at = axis.transData.transform(points)
    renderer = figure.canvas.get_renderer()
    beads = [p for line in lines for p in _beads(axis.transData.transform(line), BEAD * dot)]
    taken = [np.array([*(p - r * dot), *(p + r * dot)]) for places, r in ((at, 2.5), (beads, 1.0)) for p in places]
    for name, point, place in zip(names, points, at, strict=True):
        text = axis.annotate(
            name, point, (0.0, 0.0), textcoords="offset points", fontsize=FONT, ha="center", va="center_baseline",
            path_effects=HALO, zorder=5,
        )  # fmt: skip
        box = text.get_window_extent(renderer)
        half = np.array([box.width, box.height]) / 2.0
        text.remove()
        shift = next(
            (s for s in _shifts(half / dot) if _free(place + dot * s, half, taken, figure.bbox.size)),
            np.array([NEAR, 0.0]),
        )
        middle = place + dot * shift
        taken.append(np.array([*(middle - half), *(middle + half)]))
        lead = LINE if np.linalg.norm(np.maximum(np.abs(shift) - half / dot, 0.0)) > LEAD else None
        axis.annotate(
            name, point, tuple(shift), textcoords="offset points", fontsize=FONT, ha="center",
            va="center_baseline", path_effects=HALO, arrowprops=lead, zorder=5,
        )  # fmt: skip


def _shifts(half: Array) -> list[Array]:
    """From a point to the middle of its name, points; the best first. `half` (2,): of the name's size."""
    rays = np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)
    return [r * ray + np.sign(np.round(ray, 6)) * half for r in np.arange(NEAR, FAR, STEP) for ray in rays]


def _beads(line: Array, apart: float) -> list[Array]:
    """Points along a polyline (n, 2), no farther apart than this."""
    return [a + s * (b - a) for a, b in pairwise(line)
            for s in np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(np.linalg.norm(b - a) / apart))))]  # fmt: skip


def _free(middle: Array, half: Array, taken: Sequence[Array], size: Array) -> bool:
    low, high = middle - half, middle + half
    inside = (low > 0.0).all() and (high < size).all()
    return bool(inside) and not any((low < box[2:]).all() and (high > box[:2]).all() for box in taken)
