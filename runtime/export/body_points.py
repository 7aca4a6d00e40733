"""Points of bodies in the root of the profile's frames, at a fixed rate: markers, and what a law draws as points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.export.frames_in_time import Grid
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.shapes import JOINTED, Placing


@dataclass(frozen=True)
class BodyPoints:
    """Points of a recording.

    Attributes:
        names: SIGNAL:ROW, such as "skeleton.nodes:Hips".
        placed: (k, points, 3) mm, in the root.
        seen: (k, points) whether it was measured.
        fields: the signals' names.
    """

    names: list[str]
    placed: Array
    seen: NDArray[np.bool_]
    fields: set[str]


def body_points(recording: Recording, frames: Grid) -> BodyPoints:
    """All of them. Raises RecordingError: none is recorded."""
    layout = recording.layout
    fields = [f for f in layout.fields.values() if _is_points(f)]
    if not fields:
        problem = "no markers and no other points of a body are recorded"
        raise RecordingError(str(recording.path), problem, "Use --parquet or --mcap")
    names = [f"{f.name}:{name}" if name else f.name for f in fields for name in _row_names(f)]
    rows = recording.rows[frames.rows]
    placed = np.concatenate([_in_root(layout, f, rows) for f in fields], axis=1) * 1000.0
    measured = np.concatenate([_measured(recording, f) for f in fields], axis=1)[frames.rows]
    seen: NDArray[np.bool_] = np.isfinite(placed).all(axis=2) & measured & frames.there[:, None]
    return BodyPoints(names, placed, seen, {f.name for f in fields})


def _is_points(field: Field) -> bool:
    """Whether it is points of a body: x, y, z in m, drawn as points. A suit's translations aren't: they are steps."""
    if field.unit != "m" or field.shape[-1:] != (3,) or len(field.shape) > 2 or not field.size:
        return False
    return field.visual in JOINTED


def _row_names(field: Field) -> list[str]:
    if len(field.shape) == 1:
        return [""]
    return list(field.labels) if len(field.labels) == field.shape[0] else [str(i) for i in range(field.shape[0])]


def _in_root(layout: Layout, field: Field, rows: NDArray[np.int64]) -> Array:
    """(k, points, 3) in the root's coordinates, m. NaN while a frame on the way isn't known."""
    values = layout.value(rows, field.name).reshape(len(rows), -1, 3)
    placing = Placing(layout)
    frame, measured = field.frame, False
    while frame in placing.frames:
        measured = measured or placing.frames[frame].pose in layout.fields
        frame = placing.frames[frame].parent
    T = np.stack([placing.to_root(row, field.frame) for row in (rows if measured else rows[:1])])
    moved: Array = values @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
    return moved


def _measured(recording: Recording, field: Field) -> NDArray[np.bool_]:
    """(k, points) whether a point was measured: an occluded marker and a lost device keep their last values."""
    layout, owner = recording.layout, field.name.partition(".")[0]
    count = field.shape[0] if len(field.shape) == 2 else 1
    found: NDArray[np.bool_] = np.ones((len(recording.rows), count), np.bool_)
    if owner in layout.devices:
        found &= recording.connected(owner)[:, None]
    for name in (f"{field.name}_visible", f"{field.name.removesuffix('s')}_visible"):
        if name in layout.fields and layout.fields[name].shape == (count,):
            found &= recording.value(name) > 0.5
    return found
