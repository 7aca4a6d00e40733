"""Capsules and gaps in the recording's 3D view, coloured by their distance in each row."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from srl.runtime.contracts import rotation
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.recording.shapes import distance_colors

WIRE, GAP = 0.0015, 0.003  # m, radii of a capsule's wires, and of the line across a gap


def capsule_look(field: Field) -> list[Any]:
    """What doesn't change of a signal of capsules or gaps."""
    if field.visual == "gaps":
        return [rr.LineStrips3D.from_fields(radii=[GAP])]
    fill = rr.components.FillMode.TransparentFillMajorWireframe  # the bones inside are seen
    labels = list(field.labels) or None
    return [rr.Capsules3D.from_fields(fill_mode=fill, line_radii=[WIRE], labels=labels, show_labels=False)]


def capsule_columns(field: Field, values: Array) -> list[Any]:
    """The columns of values (k, n, 8), terms.CAPSULE, or (k, n, 7), terms.GAP.

    What isn't finite is drawn as nothing; it keeps its place, so that names stay right.
    """
    k, n = values.shape[:2]
    rows = values.reshape(k * n, -1)
    shades = distance_colors(rows[:, -1])
    there: NDArray[np.bool_] = np.asarray(np.isfinite(rows[:, :-1]).all(axis=1))
    rows = np.where(there[:, None], rows, 0.0)
    start, end = rows[:, :3], rows[:, 3:6]
    each = np.full(k, n)
    if field.visual == "gaps":
        strips = [pair if ok else pair[:0] for pair, ok in zip(np.stack([start, end], axis=1), there, strict=True)]
        return [rr.LineStrips3D.columns(strips=strips, colors=shades).partition(each)]
    # The viewer's capsules begin at the given point and extend along z.
    along = end - start
    w, x, y, z = rotation.from_z(along).T
    return [
        rr.Capsules3D.columns(
            lengths=np.linalg.norm(along, axis=1),
            radii=rows[:, 6],
            translations=start,
            quaternions=np.stack([x, y, z, w], axis=1),
            colors=shades,
        ).partition(each)
    ]
