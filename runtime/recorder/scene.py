"""The views of a recording for people: 3D, loop timing, device ages, states; derived, thinned to 30 Hz.

Nothing of this is read back: the rows are in the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.linkage import Solid
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Words
from srl.runtime.profile.plots import MEASURED, TRUTH, Plot, command_plots, joint_plots, profile_plots, series_names
from srl.runtime.recorder.capsules import capsule_columns, capsule_look
from srl.runtime.recorder.robots import ROOT, Moves, RobotShapes
from srl.runtime.recorder.solid_shapes import solid_shapes
from srl.runtime.recording.columns import ArrowBatch, Columns, entity, rounded
from srl.runtime.recording.shapes import PALETTE, Color, Placing, color_numbers, colors, visuals

VIEW_RATE = 30.0  # Hz of the loop's clock
PHASES = ("read", "control", "guard", "write", "log")
# For a command's plot: asked is wide at the bottom, applied lies on it, measured is thin on top. Where they agree,
# all three can be seen.
COMMAND_COLORS = {"asked": (130, 130, 130), "applied": (86, 180, 233), "sent": (0, 158, 115)}
COMMAND_COLORS |= dict.fromkeys((MEASURED, TRUTH), (230, 159, 0))
COMMAND_WIDTHS = {"asked": 4.5, "applied": 3.0, "sent": 1.7, MEASURED: 0.8, TRUTH: 0.8}
STATE_COLORS = {
    State.STARTING: (150, 150, 150),
    State.READY: (86, 180, 233),
    State.ACTIVE: (0, 158, 115),
    State.STOPPING: (230, 159, 0),
    State.STOPPED: (213, 94, 0),
    State.ENDED: (90, 90, 90),
}
OTHER_STATE = (0, 114, 178)
# Causes that are no faults have muted colours.
CAUSE_COLORS = {Cause.NONE: (50, 50, 50), Cause.REQUEST: (90, 90, 90), Cause.END: (90, 90, 90)}
FAULT = (213, 94, 0)
JOINT, POINT, LINK, WIRE = 0.003, 0.004, 0.0012, 0.0004  # m, radii in 3D
NODE, BONE = 0.008, 0.005  # m, radii for a body
ELBOW, LIMB, ARROW, TRAIL = 0.03, 0.02, 0.012, 0.006  # m, radii for objects of an arm's size
TRAILING = 150  # points of a path that are kept: 5 s
NEWTON = 0.02  # m, length of an arrow for each newton
AXES = 0.03  # m, length of a frame's axes


@dataclass(frozen=True)
class Thinned:
    """The newest rows (k, width) of each 1/VIEW_RATE s.

    Attributes:
        timing: (k, n) by entity path: the largest of each 1/VIEW_RATE s.
        trails: k lines (points, 3) by signal, the path until each row.
    """

    rows: Words
    timing: Mapping[str, NDArray[np.float64]]
    trails: Mapping[str, list[NDArray[np.float64]]]


class Scene:
    """The views of one layout."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._layout = layout = columns.layout
        self._frames = Placing(layout).frames
        self._plots = [*command_plots(layout), *joint_plots(layout), *profile_plots(layout)]
        self._visuals = visuals(layout)
        self.robots = RobotShapes(layout)
        self._state: dict[str, int] = {}
        self._wake = 0
        self._trails: dict[str, NDArray[np.float64]] = {}  # the newest positions of each path

    def statics(self, recording: rr.RecordingStream) -> None:
        """Sends the data that doesn't change: names, colours, fixed frames."""

        def log(path: str, *what: Any) -> None:
            rr.log(path, *what, static=True, recording=recording, strict=True)

        for field in self._layout.fields.values():
            if field.size:
                suffix = {"command": " asked", "applied": " applied", "sent": " sent"}.get(field.role, "")
                names = [name + suffix for name in series_names(self._layout, field.name)]
                log(entity(field.name), lines(names))
        log("/loop/timing/period", lines(["period"]))
        log("/loop/timing/cycle", lines(["cycle"], first=1))
        log("/loop/timing/phases", lines(PHASES))
        if self._layout.devices:
            log("/loop/timing/ages", lines(self._layout.devices))
        log("/loop/state", _colored(State, STATE_COLORS, OTHER_STATE))
        log("/loop/cause", _colored(Cause, CAUSE_COLORS, FAULT))
        for plot in self._plots:
            labels = list(plot.curves(self._layout, np.zeros((1, self._layout.width), np.int64)))
            log(plot_path(plot), lines(labels))
        for name, frame in self._frames.items():
            T = homogeneous(frame.placed())
            child = f"{name} mount" if frame.pose else name
            fixed = rr.Transform3D(
                translation=T[:3, 3], mat3x3=T[:3, :3], parent_frame=frame.parent or ROOT, child_frame=child
            )
            log(rr.new_entity_path(["frames", child]), fixed)
            path = rr.new_entity_path(["axes", name])
            log(path, rr.CoordinateFrame(name), rr.TransformAxes3D(AXES))
        self.robots.statics(recording, self._frames)
        drawn = {robot.name for robot in self.robots.robots}
        scenery = [s for s in self._layout.meta.get("scenery", []) if s.get("part") not in drawn]
        for kind, shape in _scenery(scenery):
            log(f"/scenery/{kind}", shape)
        numbers = color_numbers(self._visuals)
        for field in self._visuals:
            path = entity(field.name)
            if field.frame in self._frames:
                log(path, rr.CoordinateFrame(field.frame))
            for look in _looks(field, colors(numbers[field.name])):
                log(path, look)

    def thin(self, rows: Words) -> Thinned:
        """The rows that are drawn, of rows (k, width), which must follow those of the last call."""
        now = self._layout.header(rows, "now")
        bins = np.floor_divide(now, int(1e9 / VIEW_RATE))
        ends = np.append(np.flatnonzero(np.diff(bins)), len(rows) - 1)
        starts = np.append(0, ends[:-1] + 1)
        if self._wake == 0 and ends[0] > 0:  # the very first row, so that the views show data from the start
            ends, starts = np.append(0, ends), np.insert(starts, 1, 1)
        timing = {path: np.fmax.reduceat(values, starts, axis=0) for path, values in self._timing(rows).items()}
        trails = {
            f.name: self._trail(f.name, self._layout.value(rows[ends], f.name)[:, :3])
            for f in self._visuals
            if f.visual == "path"
        }
        return Thinned(rows[ends], timing, trails)

    def send(self, recording: rr.RecordingStream, thinned: Thinned) -> None:
        """Sends the views of what was thinned."""
        columns, thin = self._sender(recording), thinned.rows
        for path, largest in thinned.timing.items():
            columns(path, thin, scalars(largest))
        for plot in self._plots:
            curves = plot.curves(self._layout, thin)
            columns(plot_path(plot), thin, scalars(np.stack(list(curves.values()), axis=1)))
        for field in self._visuals:
            if field.name in thinned.trails:
                strips = thinned.trails[field.name]
                shape = [_strips(strips, 1)]
            else:
                shape = _shape(field, self._layout.value(thin, field.name))
            columns(entity(field.name), thin, *shape)
        moves = Moves()
        self._measured_frames(moves, thin)
        self.robots.move(moves, thin)
        moves.send(thin, columns)

    def send_states(self, recording: rr.RecordingStream, rows: Words) -> None:
        """Sends the changes of state and cause in rows (k, width), which must follow those of the last call."""
        columns = self._sender(recording)
        for word, names in (("state", State), ("cause", Cause)):
            values = self._layout.header(rows, word)
            before = np.append(self._state.get(word, -1), values[:-1])
            changed = np.flatnonzero(values != before)
            self._state[word] = int(values[-1])
            if len(changed):
                known = {int(n): n.name.lower() for n in names}
                texts = [known.get(int(values[i]), str(values[i])) for i in changed]
                columns(f"/loop/{word}", rows[changed], rr.StateChange.columns(state=texts))

    def _sender(self, recording: rr.RecordingStream) -> Callable[..., None]:
        def columns(path: str, at: Words, *what: Any) -> None:
            rr.send_columns(
                path, self._columns.times(at), [c for w in what for c in w], recording=recording, strict=True
            )

        return columns

    def _timing(self, rows: Words) -> dict[str, NDArray[np.float64]]:
        """Durations by entity path, (k, n): us for the phases, ms for the others."""
        word = {name: self._layout.header(rows, name) for name in ("now", "wake", *PHASES)}
        before = np.append(self._wake, word["wake"][:-1])
        period = np.where(before > 0, (word["wake"] - before) / 1e6, np.nan)  # the first row has none
        self._wake = int(word["wake"][-1])
        marks = np.stack([word[name] for name in ("wake", "read", "control", "guard", "write")], axis=1)
        phases = np.column_stack([np.diff(marks, axis=1), word["log"]])
        timing = {
            "/loop/timing/period": period[:, None],
            "/loop/timing/cycle": (word["write"] - word["wake"])[:, None] / 1e6,
            "/loop/timing/phases": phases / 1e3,
        }
        if self._layout.devices:
            stamps = np.stack([self._layout.header(rows, f"{d}.stamp") for d in self._layout.devices], axis=1)
            ages = (word["now"][:, None] - stamps) / 1e6
            timing["/loop/timing/ages"] = np.where(stamps < 0, np.nan, ages)
        return timing

    def _trail(self, name: str, positions: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """The path of the last seconds, for each of the positions (k, 3)."""
        before = self._trails.get(name, positions[:0])
        whole = np.concatenate([before, positions])
        self._trails[name] = whole[-TRAILING:]
        strips = [whole[max(end - TRAILING, 0) : end] for end in range(len(before) + 1, len(whole) + 1)]
        return [strip[strip.any(axis=1)] for strip in strips]  # a position before the first sample is all zeros

    def _measured_frames(self, moves: Moves, thin: Words) -> None:
        for name, frame in self._frames.items():
            if frame.pose in self._layout.fields:
                poses = np.array([as_pose(pose) for pose in self._layout.value(thin, str(frame.pose))])
                moves.add(poses, f"{name} mount", name)  # a pose before the first sample isn't finite


def plot_path(plot: Plot) -> str:
    """The path of the entity with a plot's curves."""
    path: str = rr.new_entity_path(["plots", plot.title])
    return path


def _scenery(shapes: Sequence[Mapping[str, Any]]) -> list[tuple[str, Any]]:
    """The fixed objects of the simulated world, by kind."""
    return solid_shapes([Solid(s["kind"], s["size"], (*s["position"], *s["quaternion"]), s["colour"]) for s in shapes])


def _looks(field: Field, color: list[Color]) -> list[Any]:
    """The radii and names of a signal, and its colours, one a row or one for all, where they don't change."""
    match field.visual:
        case "capsules" | "gaps":
            return capsule_look(field)
        case "sphere":
            fill = rr.components.FillMode.TransparentFillMajorWireframe
            return [rr.Ellipsoids3D.from_fields(colors=[(*color[0], 60)], fill_mode=fill, line_radii=[WIRE])]
        case "path":
            return [rr.LineStrips3D.from_fields(colors=color, radii=[TRAIL])]
        case "arrow":
            return [rr.Arrows3D.from_fields(colors=color, radii=[ARROW])]
    linked = bool(field.links)
    rows = [f"{field.name} {label}" for label in field.labels] if len(field.shape) > 1 else [field.name]
    labels = list(field.labels) if linked else rows
    thick = {"robot": (ELBOW, LIMB), "skeleton": (NODE, BONE)}
    radius, width = thick.get(field.visual, (JOINT if linked else POINT, LINK))
    strips = [color[link[0]] for link in field.links] if len(color) > 1 else color
    return [
        rr.Points3D.from_fields(colors=color, radii=[radius], labels=labels or None, show_labels=False),
        rr.LineStrips3D.from_fields(colors=strips, radii=[width]),
    ]


def lines(names: Sequence[str], first: int = 0) -> rr.SeriesLines:
    """Names and colours of series. The colours begin with the palette's colour number `first`."""
    if set(names) <= COMMAND_COLORS.keys():
        return rr.SeriesLines(
            names=names, colors=[COMMAND_COLORS[n] for n in names], widths=[COMMAND_WIDTHS[n] for n in names]
        )
    colors = [PALETTE[(first + i) % len(PALETTE)] for i in range(len(names))]
    return rr.SeriesLines(names=names, colors=colors, widths=[1.5] * len(names))


def _colored(names: type[IntEnum], colors: Mapping[Any, tuple[int, int, int]], other: tuple[int, int, int]) -> Any:
    values = [n.name.lower() for n in names]
    return rr.StateConfiguration(values=values, colors=[(*colors.get(n, other), 255) for n in names])


def scalars(values: NDArray[np.float64]) -> Any:
    """The columns of values (k, n), which are n series, with the precision of float32: that compresses."""
    k, n = values.shape
    return rr.Scalars.columns(scalars=rounded(values).ravel()).partition(np.full(k, n))


def _shape(field: Field, values: NDArray[np.float64]) -> list[Any]:
    k = len(values)
    if field.visual == "sphere":
        center, radius = values[:, :3], values[:, 3:]
        return [rr.Ellipsoids3D.columns(centers=center, half_sizes=np.repeat(radius, 3, axis=1))]
    if field.visual in ("capsules", "gaps"):
        return capsule_columns(field, values)
    if field.visual == "arrow":
        return [rr.Arrows3D.columns(origins=values[:, 0], vectors=NEWTON * values[:, 1])]
    points = values.reshape(k, -1, 3)
    shown = [rr.Points3D.columns(positions=points.reshape(-1, 3)).partition(np.full(k, points.shape[1]))]
    if field.links:
        shown.append(_strips([v[list(link)] for v in values for link in field.links], len(field.links)))
    return shown


def _strips(strips: Sequence[NDArray[np.float64]], each: int) -> list[rr.ComponentColumn]:
    """The column of lines (points, 3), `each` in a row. With rerun's own this took a fifth of a merge."""
    points = np.concatenate([np.empty((0, 3)), *strips]).astype(np.float32)
    corner = pa.list_(pa.field("item", pa.float32(), nullable=False), 3)
    line = pa.list_(pa.field("item", corner, nullable=False))
    ends = pa.array(np.append(0, np.cumsum([len(strip) for strip in strips])).astype(np.int32))
    made = pa.ListArray.from_arrays(ends, pa.FixedSizeListArray.from_arrays(points.ravel(), type=corner), type=line)
    lengths = np.full(len(strips) // each, each)
    return [rr.ComponentColumn(rr.LineStrips3D.descriptor_strips(), ArrowBatch(made), lengths=lengths)]
