"""Pictures of a recording at single instants, side by side: what the 3D view shows, on paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.runtime.pictures.camera import back_of
from srl.runtime.pictures.chosen import chosen
from srl.runtime.pictures.figure import COLORS
from srl.runtime.pictures.naming import write_names
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.shapes import RAMP, distance_colors, visuals
from srl.runtime.recording.solids import Solids, Thing

ACROSS = 5  # pictures in a row
SIZE = (2.3, 3.1)  # inches of one among others
ALONE = (6.0, 7.0)  # inches of a single one
NAMED = 1.6  # inches of a name in the legend
ARC = np.linspace(-np.pi / 2, np.pi / 2, 25)
# From what is looked at to the eye, in the root frame: a body's front is its x, its left is y.
SIDES = {"front": (1.0, 0.0, 0.0), "back": (-1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0), "right": (0.0, -1.0, 0.0)}


@dataclass(frozen=True)
class View:
    """A parallel projection. Attributes: right, up, back (3,): unit vectors in the root frame; back is to the eye."""

    right: Array
    up: Array
    back: Array

    def flat(self, points: Array) -> Array:
        """(k, 2) m of points (k, 3)."""
        found: Array = points @ np.stack([self.right, self.up], axis=1)
        return found


class Scene:
    """What is drawn of a recording, and from where one looks.

    Args:
        recording: what is drawn.
        show: the signals, or parts, that are drawn; none: all that have a shape.
        side: of SIDES, from which one looks; None: from the front and a little from the right and above.

    Attributes:
        things: what is drawn.
        view: the projection.

    Raises:
        RecordingError: no signal has a shape, or none of them is in `show`.
    """

    def __init__(self, recording: Recording, show: Sequence[str] = (), side: str | None = None) -> None:
        self._solids = Solids(recording.layout)
        if not self._solids.things:
            raise RecordingError(str(recording.path), "no signal in it has a shape", "Record a profile that shows some")
        self._shown = chosen(self._solids.things, show)
        self.things = [_part(self._solids.things[i], kept) for i, kept in self._shown.items()]
        self.view = _view(np.array(SIDES[side]) if side else back_of(visuals(recording.layout)))

    def of(self, row: NDArray[np.int64]) -> list[Array]:
        """What each thing is in a row (width,): points (k, 3), or capsules (k, 8), m in the root frame."""
        found = self._solids.of(row)
        return [
            found[i][list(kept)] if thing.groups else found[i]
            for thing, (i, kept) in zip(self.things, self._shown.items(), strict=True)
        ]

    def frame(self, shapes: Sequence[Sequence[Array]]) -> tuple[Array, Array]:
        """The middle of each picture (n, 2), and half of the width and height (2,) that all of them need, m."""
        return _frame(self.view, shapes)

    def paint(self, axis: Any, shape: Sequence[Array], middle: Array, reach: Array) -> None:
        """Draws what `of` gave; `middle`, `reach` (2,) m: see `frame`."""
        for thing, values in zip(self.things, shape, strict=True):
            (_points if thing.points else _capsules)(axis, self.view, thing, values)
        axis.set_xlim(middle[0] - reach[0], middle[0] + reach[0])
        axis.set_ylim(middle[1] - reach[1], middle[1] + reach[1])
        axis.set_aspect("equal")


def draw(
    recording: Recording,
    png: Path,
    times: Sequence[float],
    names: Sequence[str] = (),
    show: Sequence[str] = (),
    side: str | None = None,
) -> None:
    """Draws the newest row at each of the times, s from the first row.

    Args:
        recording: what is drawn.
        png: where.
        times: at least one.
        names: the parts of the body (`Signal.groups`) whose nodes are named.
        show: the signals, or parts, that are drawn; none: all that have a shape.
        side: of SIDES, from which one looks; None: from the front and a little from the right and above.
    Raises:
        RecordingError: no signal that is drawn has a shape, a time lies outside, no such part, it can't be written.
    """  # fmt: skip
    scene = Scene(recording, show, side)
    parts = list(dict.fromkeys(name for thing in scene.things for name in thing.groups))
    for name in names:
        if name not in parts:
            raise RecordingError("--names", f"no part that is drawn is called '{name}'", nearest(name, parts))
    rows = rows_at(recording, times, "--at")
    shapes = [scene.of(row) for row in rows]
    middles, reach = scene.frame(shapes)
    columns = min(len(rows), ACROSS)
    lines = -(-len(rows) // columns)
    size = ALONE if len(rows) == 1 else (SIZE[0] * columns, SIZE[1] * lines + 0.7)
    figure, axes = plt.subplots(lines, columns, figsize=size, squeeze=False, layout="constrained")
    try:
        for axis in axes.flat:
            axis.axis("off")
        for i, (row, shape) in enumerate(zip(rows, shapes, strict=True)):
            axis = axes.flat[i]
            letter = f"({chr(97 + i)}) " if len(rows) > 1 and i < 26 else ""
            cycle = int(recording.layout.header(row, "cycle"))
            state = int(recording.layout.header(row, "state"))
            late = "" if state == State.ACTIVE else ", no law runs"
            axis.set_title(f"{letter}{times[i]:.2f} s, cycle {cycle}{late}", fontsize=8)
            scene.paint(axis, shape, middles[i], reach)
        legend(figure, scene.things, 4 if len(rows) == 1 else max(2, int(size[0] / NAMED)))
        figure.suptitle(title(recording), fontsize=10)
        if names:
            figure.draw_without_rendering()  # places and limits are final now
        for axis, shape in zip(axes.flat, shapes, strict=False):
            _names(axis, scene.view, scene.things, shape, names)
        figure.savefig(png, dpi=130, format="png")
    except OSError as error:
        raise RecordingError(str(png), f"it can't be written: {error.strerror}", "Choose another place") from None
    finally:
        plt.close(figure)


def title(recording: Recording) -> str:
    """The profile's name, and whether a device was simulated."""
    simulated = " (simulated)" if recording.layout.simulated else ""
    return f"{recording.layout.meta.get('name', '')}{simulated}"


def spread(recording: Recording, count: int) -> list[float]:
    """`count` times, s, equally far apart while the limb was in motion; of the whole recording if it never was."""
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    moving = now[recording.int("state") == State.ACTIVE]
    ends = moving if len(moving) > 1 else now
    margin = 0.5 * (ends[-1] - ends[0]) / count  # in the middle of equal parts: laws have begun, and haven't ended
    found: list[float] = np.linspace(ends[0] + margin, ends[-1] - margin, count).tolist()
    return found


def _part(thing: Thing, kept: Sequence[int]) -> Thing:
    """The thing with these of its rows alone, and the links between them."""
    if len(kept) == len(thing.groups) or not thing.groups:
        return thing
    number = {row: i for i, row in enumerate(kept)}
    pairs = [pair for line in thing.links for pair in pairwise(line) if set(pair) <= set(kept)]
    each = thing.numbers if len(thing.numbers) > 1 else thing.numbers * len(thing.groups)
    return replace(
        thing, numbers=tuple(each[i] for i in kept), labels=tuple(thing.labels[i] for i in kept),
        groups=tuple(thing.groups[i] for i in kept), links=tuple((number[a], number[b]) for a, b in pairs),
    )  # fmt: skip


def rows_at(recording: Recording, times: Sequence[float], option: str) -> list[NDArray[np.int64]]:
    """The newest row at each time, s from the first row; `option` gave them, for the error of a time outside."""
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    for t in times:
        if not 0.0 <= t <= now[-1] + 1e-6:
            raise RecordingError(option, f"the recording has no {t:g} s", f"Give times from 0 to {now[-1]:.2f} s")
    return [recording.rows[i] for i in np.searchsorted(now, np.asarray(times) + 1e-6, "right") - 1]


def _view(back: Array) -> View:
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return View(right, np.cross(back, right), back)


def _frame(view: View, shapes: Sequence[Sequence[Array]]) -> tuple[Array, Array]:
    """The middle of each picture (n, 2), and half of the width and height that all of them need, m."""
    middles, reach = np.zeros((len(shapes), 2)), np.full(2, 0.05)
    for i, shape in enumerate(shapes):
        ends = [np.insert(v[:, at : at + 3], 3, v[:, 6] if v.shape[1] > 3 else 0.0, axis=1)
                for v in shape for at in ((0, 3) if v.shape[1] > 3 else (0,))]  # fmt: skip
        known = np.concatenate(ends)
        known = known[np.isfinite(known).all(axis=1)]
        if len(known):
            points, margin = view.flat(known[:, :3]), known[:, 3:]
            low, high = (points - margin).min(axis=0), (points + margin).max(axis=0)
            middles[i], reach = (low + high) / 2, np.maximum(reach, 1.05 * (high - low) / 2)
    return middles, reach


def _points(axis: Any, view: View, thing: Thing, places: Array) -> None:
    colors = [COLORS[n % len(COLORS)] for n in thing.numbers]
    each = colors if len(colors) > 1 else colors * len(places)
    flat, depth = view.flat(places), places @ view.back
    lines = [flat[list(link)] for link in thing.links]
    order = np.argsort([np.nanmean(depth[list(link)]) for link in thing.links])
    width = 1.6 if thing.groups else 0.9
    axis.add_collection(
        LineCollection(
            [lines[i] for i in order], colors=[each[thing.links[i][0]] for i in order], linewidths=width,
            capstyle="round", joinstyle="round", zorder=3,
        )
    )  # fmt: skip
    axis.scatter(*flat.T, s=4 if thing.groups else 2, c=each, linewidths=0, zorder=4)


def _names(axis: Any, view: View, things: Sequence[Thing], shape: Sequence[Array], parts: Sequence[str]) -> None:
    lines = [view.flat(places[list(link)]) for thing, places in zip(things, shape, strict=True) for link in thing.links]
    lines = [line for line in lines if np.isfinite(line).all()]
    for thing, places in zip(things, shape, strict=True):
        named = [i for i, group in enumerate(thing.groups) if group in parts and np.isfinite(places[i]).all()]
        if named:
            write_names(axis, [thing.labels[i] for i in named], view.flat(places[named]), lines)


def _capsules(axis: Any, view: View, thing: Thing, values: Array) -> None:
    values = values[np.isfinite(values[:, :7]).all(axis=1)]
    if not len(values):
        return
    values = values[np.argsort((values[:, :3] + values[:, 3:6]) @ view.back)]
    if thing.numbers:
        colors = np.tile(mpl.colors.to_rgb(COLORS[thing.numbers[0] % len(COLORS)]), (len(values), 1))
    else:
        colors = distance_colors(values[:, 7]) / 255.0
    faces = [_outline(view.flat(v[:6].reshape(2, 3)), v[6]) for v in values]
    clear = np.column_stack([colors, np.full(len(colors), 1.0 if thing.solid else 0.3)])
    axis.add_collection(PolyCollection(faces, facecolors=clear, edgecolors=0.8 * colors, linewidths=0.7, zorder=2))


def _outline(ends: Array, radius: float) -> Array:
    """The silhouette (k, 2) of a capsule whose axis has these ends (2, 2): that of a parallel projection."""
    along = ends[1] - ends[0]
    angle = np.arctan2(along[1], along[0])
    arcs = [end + radius * np.stack([np.cos(a), np.sin(a)], axis=1)
            for end, a in ((ends[1], angle + ARC), (ends[0], angle + np.pi + ARC))]  # fmt: skip
    return np.concatenate(arcs)


def legend(figure: Any, things: Sequence[Thing], columns: int) -> None:
    """Says below the pictures what the colours of the things are."""
    named: dict[str, str] = {}
    for thing in sorted(things, key=lambda t: not t.groups):
        names = thing.groups or (thing.name,) * len(thing.numbers)
        named |= {name: COLORS[n % len(COLORS)] for name, n in zip(names, thing.numbers, strict=True)}
    if any(not thing.numbers for thing in things):
        named |= {f"{m:g} m away": mpl.colors.to_hex([c / 255 for c in color]) for m, color in RAMP}
    handles = [plt.Line2D([], [], color=color, linewidth=3) for color in named.values()]
    figure.legend(handles, named, loc="outside lower center", ncols=min(len(named), columns), fontsize=8, frameon=False)
