"""A recording as C3D: points of bodies in mm, and the devices' other numbers as analog channels.

A point is named SIGNAL:ROW ("skeleton.nodes:Hips"), an analog channel as in `srl.runtime.recording.elements`. Points
are in the root of the profile's frames, as in the pictures. C3D has one fixed rate, 32-bit numbers and neither text nor
time stamps; what that leaves out is reported.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.export.body_points import BodyPoints, body_points
from srl.runtime.export.frames_in_time import Grid, grid
from srl.runtime.export.report import Report, listed, needed, whole_file
from srl.runtime.recording.elements import elements
from srl.runtime.recording.reader import Recording

MOST_FRAMES: Final = 65535  # that a C3D file's header counts
MOST_CHANNELS: Final = 255  # names that a C3D parameter holds
LONGEST: Final = 127  # bytes of a name


def write(recording: Recording, target: Path, rate: Fraction | None = None) -> Report:
    """Writes `target`.

    Args:
        recording: what is written.
        target: FILE.c3d.
        rate: frames per second; None: the loop's rate.
    Raises:
        RecordingError: no body's points are recorded, there are too many frames or names, or it can't be written.
        HostError: the package isn't installed.
    """
    ezc3d = needed("ezc3d", "--c3d")
    layout = recording.layout
    frames = grid(recording, rate)
    points = body_points(recording, frames)
    if len(frames.rows) > MOST_FRAMES:
        problem = f"it would have {len(frames.rows)} frames, and a C3D file holds {MOST_FRAMES}"
        raise RecordingError(str(target), problem, f"Write fewer a second: --rate {_fitting(recording)}")
    analogs = [f for f in layout.fields.values() if f.role == "state" and f.name not in points.fields and f.size]
    while sum(f.size for f in analogs) > MOST_CHANNELS:
        analogs.remove(max(analogs, key=lambda f: f.size))
    labels = points.names
    channels = [e for f in analogs for e in elements(f)]
    _check_names(target, [*labels, *(e.name for e in channels)], len(labels))
    made = ezc3d.c3d()
    _add(made, recording, frames, points, analogs, channels)
    with whole_file(target) as part:
        try:
            made.write(str(part))
        except RuntimeError as error:  # all that ezc3d raises
            raise OSError(str(error)) from None
    content = (
        f"{len(frames.rows)} frames of {len(labels)} points and {len(channels)} channels, {frames.rate:g} a second"
    )
    return Report([target], content, _left_out(recording, frames, points.fields | {f.name for f in analogs}))


def _fitting(recording: Recording) -> int:
    now = recording.int("now")
    return max(int((MOST_FRAMES - 1) / max((now[-1] - now[0]) / 1e9, 1e-3)), 1)


def _check_names(target: Path, names: list[str], points: int) -> None:
    if points > MOST_CHANNELS:
        problem = f"it would have {points} points, and a C3D file holds {MOST_CHANNELS} with names"
        raise RecordingError(str(target), problem, "Use --parquet or --mcap")
    if long := next((name for name in names if len(name.encode()) > LONGEST), None):
        problem = f"the name '{long}' is longer than the {LONGEST} bytes that C3D has for one"
        raise RecordingError(str(target), problem, "Use --parquet or --mcap")


def _add(
    made: Any, recording: Recording, frames: Grid, points: BodyPoints, analogs: list[Field], channels: list[Any]
) -> None:  # fmt: skip
    layout, rows = recording.layout, recording.rows[frames.rows]
    labels, placed, seen = points.names, points.placed, points.seen
    data = np.ones((4, len(labels), len(rows)))
    data[:3] = np.where(seen[..., None], placed, 0.0).transpose(2, 1, 0)
    parameters = made["parameters"]
    parameters["POINT"]["RATE"]["value"] = [frames.rate]
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["POINT"]["LABELS"]["value"] = labels
    made["data"]["points"] = data
    made["data"]["meta_points"]["residuals"] = np.where(seen, 0.0, -1.0).T[None]  # -1: not measured, as C3D says it
    parameters["ANALOG"]["RATE"]["value"] = [frames.rate]
    parameters["ANALOG"]["LABELS"]["value"] = [e.name for e in channels]
    parameters["ANALOG"]["UNITS"]["value"] = [e.unit for e in channels]
    values = [layout.value(rows, f.name).reshape(len(rows), -1) for f in analogs]
    made["data"]["analogs"] = (np.concatenate(values, axis=1) if values else np.zeros((len(rows), 0))).T[None]
    made.add_parameter("SRL", "PROFILE", str(layout.meta.get("name", "")))
    made.add_parameter("SRL", "SHA256", str(layout.meta.get("sha256", "")))


def _left_out(recording: Recording, frames: Grid, held: set[str]) -> list[str]:
    rest = [f.name for f in recording.layout.fields.values() if f.name not in held and f.size]
    left_out = [f"{len(rest)} signals: {listed(rest)}"] if rest else []
    left_out += [
        "the loop's and the devices' time stamps, states and counts",
        "the profile's text and calibration files",
    ]
    left_out += [f"{len(recording.events)} events"] if recording.events else []
    left_out += [f"{frames.skipped} rows that fall between the frames"] if frames.skipped else []
    left_out += ["what 64-bit numbers have beyond 32-bit ones"]
    if gone := int((~frames.there).sum()):
        left_out.append(f"{gone} frames have no row; their points are marked as not measured")
    return left_out
