"""A recording for OpenSim: markers and other points of a body as TRC, joint positions as MOT.

Both are tables of text at a fixed rate. OpenSim's world has y up: x forward, z right. Source: OpenSim documentation,
"Marker (.trc) Files", "Motion (.mot) Files", "Coordinate Systems".
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.export.body_points import body_points
from srl.runtime.export.frames_in_time import grid
from srl.runtime.export.report import Report, listed, whole_file
from srl.runtime.messages.messages import JOINT_STATE, joint_names, kind_of
from srl.runtime.recording.reader import Recording

MADE: Final = "srl-runtime"  # by which a file says what made it


def write_trc(recording: Recording, target: Path, rate: Fraction | None = None) -> Report:
    """Writes points in mm, y up; what wasn't measured is empty. `rate`: frames per second; None: the loop's.

    The profile's root is taken to have z up, x forward.

    Raises:
        RecordingError: no body's points are recorded, or it can't be written.
    """
    frames = grid(recording, rate)
    points = body_points(recording, frames)
    names = _unique([name.replace(" ", "_") for name in points.names])
    count = len(frames.rows)
    rate_text = f"{frames.rate:g}"
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{target.name} {MADE}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate_text}\t{rate_text}\t{count}\t{len(names)}\tmm\t{rate_text}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(names) + 1)),
        "",
    ]
    y_up = points.placed[..., [0, 2, 1]] * (1.0, 1.0, -1.0)
    for i, (placed, seen) in enumerate(zip(y_up, points.seen, strict=True)):
        cells = ["\t".join(f"{v:.6f}" for v in p) if ok else "\t\t" for p, ok in zip(placed, seen, strict=True)]
        # A tab at the end, too: OpenSim's reader doesn't see an empty cell after the last one.
        lines.append(f"{i + 1}\t{i / frames.rate:.6f}\t" + "\t".join(cells) + "\t")
    _write(target, lines)
    return Report(
        [target], f"{count} frames of {len(names)} points, {rate_text} a second", _left_out(recording, points.fields)
    )


def write_mot(recording: Recording, target: Path, rate: Fraction | None = None) -> Report:
    """Writes joint positions, in degrees; in m where a joint slides. Raises RecordingError: there are none, ..."""
    layout, frames = recording.layout, grid(recording, rate)
    fields = [f for f in layout.fields.values() if _is_joints(f)]
    if not fields:
        raise RecordingError(str(recording.path), "no joint positions are recorded", "Use --parquet or --mat")
    names, columns = ["time"], [np.arange(len(frames.rows)) / frames.rate]
    single = [name for field in fields for name in joint_names(field)]
    for field in fields:
        owner = field.name.partition(".")[0]
        values: Array = layout.value(recording.rows[frames.rows], field.name).astype(float)
        for i, name in enumerate(joint_names(field)):
            slides = field.unit == "m" or name in field.slides
            names.append((name if single.count(name) == 1 else f"{owner}_{name}").replace(" ", "_"))
            column = values[:, i] if slides else np.degrees(values[:, i])
            columns.append(np.where(frames.there, column, np.nan))
    table = np.stack(columns, axis=1)
    head = [f"{target.stem} {MADE}", "version=1", f"nRows={len(table)}", f"nColumns={len(names)}", "inDegrees=yes",
            "endheader", "\t".join(_unique(names))]  # fmt: skip
    _write(target, head + ["\t".join(f"{v:.8g}" for v in row) for row in table])
    return Report(
        [target], f"{len(table)} rows of {len(names) - 1} joints", _left_out(recording, {f.name for f in fields})
    )


def _is_joints(field: Field) -> bool:
    measured = field.role in ("state", "internal") and field.name.rpartition(".")[2] in ("position", "angles")
    return (
        measured
        and field.size > 0
        and field.unit in ("rad", "m")
        and (kind_of(field) == JOINT_STATE or field.name.endswith(".angles"))
        and len(field.shape) == 1
    )


def _unique(names: list[str]) -> list[str]:
    found: list[str] = []
    for name in names:
        found.append(name if name not in found else f"{name}_{found.count(name) + 1}_{len(found)}")
    return found


def _left_out(recording: Recording, held: set[str]) -> list[str]:
    rest = [f.name for f in recording.layout.fields.values() if f.name not in held and f.size]
    left_out = [f"{len(rest)} signals: {listed(rest)}"] if rest else []
    return [*left_out, *([f"{len(recording.events)} events"] if recording.events else [])]


def _write(target: Path, lines: list[str]) -> None:
    with whole_file(target) as part:
        part.write_text("\n".join(lines) + "\n")
