"""What the pictures draw, as visualization_msgs/msg/MarkerArray, which RViz and Foxglove's 3D panel show.

Points, bodies, gaps and arrows are those of `recording.solids`. The robots aren't among them: their URDF and tf show
them. Each message begins with DELETEALL, so that it is a whole picture: what isn't known isn't in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts import rotation
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import time_of
from srl.runtime.recording.shapes import PALETTE, UNKNOWN, colors, distance_colors
from srl.runtime.recording.solids import GAP, Solids, Thing

MARKERS: Final = "visualization_msgs/msg/MarkerArray"
# Of visualization_msgs/msg/Marker: its types, and an action.
ARROW, CUBE, SPHERE, CYLINDER, LINE_LIST, SPHERE_LIST = 0, 1, 2, 3, 5, 7
DELETE_ALL: Final = 3
CLEAR: Final = 0.35  # alpha of what one can see through
HEAD: Final = 2.0  # of an arrow, in diameters of its shaft
_HERE: Final[Pose] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_EMPTY: Final = {
    "action": 0, "lifetime": {"sec": 0, "nanosec": 0}, "frame_locked": False, "points": (), "colors": (),
    "texture_resource": "", "uv_coordinates": (), "text": "", "mesh_resource": "",
    "texture": {"header": {"stamp": time_of(0), "frame_id": ""}, "format": "", "data": ()},
    "mesh_file": {"filename": "", "data": ()}, "mesh_use_embedded_materials": False,
}  # fmt: skip


class Scene:
    """The markers of one layout, in one frame.

    Attributes:
        there: whether it has any.
    """

    def __init__(self, layout: Layout, frame: str) -> None:
        """`frame`: the root's name."""
        self._frame, self._solids = frame, Solids(layout, with_robots=False)
        self._arrows = {name for name, field in layout.fields.items() if field.visual == "arrow"}
        self.there = bool(self._solids.things)

    def message(self, row: NDArray[np.int64], stamp: int) -> cdr.Message:
        """The markers of a row (width,), m in the root frame. `stamp`: Unix ns.

        A law's are grey while no law runs.
        """
        markers = _Markers(self._frame, stamp)
        active = row[CYCLE.state] == State.ACTIVE
        for thing, shape in zip(self._solids.things, self._solids.of(row), strict=True):
            colour = _colours(thing, shape, grey=thing.law and not active)
            known: NDArray[np.bool_] = np.asarray(np.isfinite(shape[:, : 3 if thing.points else 7]).all(axis=1))
            if thing.points:
                _points(markers, thing, shape, colour, known)
            elif thing.name in self._arrows:
                _arrows(markers, thing.name, shape[known], colour[known])
            elif not thing.numbers and thing.solid:  # gaps
                markers.add(
                    thing.name, LINE_LIST, (2 * GAP, 0, 0), points=_ends(shape[known]), colors=_two(colour[known])
                )
            else:
                _capsules(markers, thing.name, shape[known], colour[known])
        return {"markers": markers.found}


def scenery(layout: Layout, frame: str, stamp: int) -> cdr.Message:
    """The simulated world's fixed objects, without the robots'. `frame`: the root's name; `stamp`: Unix ns."""
    markers = _Markers(frame, stamp)
    drawn = {robot.get("name") for robot in layout.meta.get("robots", ()) if isinstance(robot, dict)}
    for solid in layout.meta.get("scenery", ()):
        if solid.get("part") in drawn:
            continue
        colour = np.array(solid["colour"], float)
        pose: Pose = (*solid["position"], *solid["quaternion"])
        size, name = solid["size"], str(solid.get("part") or "world")
        match solid["kind"]:
            case "box":
                markers.add(name, CUBE, [2 * s for s in size], pose, colour)
            case "cylinder":
                markers.add(name, CYLINDER, (2 * size[0], 2 * size[0], 2 * size[1]), pose, colour)
            case "sphere":
                markers.add(name, SPHERE, (2 * size[0],) * 3, pose, colour)
            case "capsule":
                ends = [rotation.composed(pose, (0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0))[:3] for z in (-size[1], size[1])]
                row = np.array([[*ends[0], *ends[1], size[0], np.nan]])
                _capsules(markers, name, row, colour[None])
    return {"markers": markers.found}


class _Markers:
    """Collects markers; each has a number in its namespace."""

    def __init__(self, frame: str, stamp: int) -> None:
        self._header = {"stamp": time_of(stamp), "frame_id": frame}
        self._counts: dict[str, int] = {}
        self.found: list[cdr.Message] = []
        self.add("", ARROW, (0, 0, 0), action=DELETE_ALL)

    def add(
        self, ns: str, kind: int, scale: Sequence[float], pose: Pose = _HERE, colour: Array | None = None, **more: Any
    ) -> None:
        """Adds one. `colour`: (4,) from 0 to 1; None: the list's own. A list without points isn't added."""
        if len(more.get("points", _HERE)) == 0:
            return
        number = self._counts[ns] = self._counts.get(ns, -1) + 1
        r, g, b, a = (1.0, 1.0, 1.0, 1.0) if colour is None else colour.tolist()
        x, y, z, qw, qx, qy, qz = pose
        self.found.append(_EMPTY | {
            "header": self._header, "ns": ns, "id": number, "type": kind,
            "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}},
            "scale": {"x": scale[0], "y": scale[1], "z": scale[2]}, "color": {"r": r, "g": g, "b": b, "a": a},
        } | more)  # fmt: skip


def _colours(thing: Thing, shape: Array, grey: bool) -> Array:
    """(k, 4) from 0 to 1, one a row."""
    if grey:
        found = np.tile(UNKNOWN, (len(shape), 1))
    elif not thing.numbers:
        found = distance_colors(shape[:, -1])
    else:
        given = np.array(colors(thing.numbers, PALETTE))
        found = given if len(given) == len(shape) else np.tile(given[0], (len(shape), 1))
    return np.column_stack([found / 255, np.full(len(shape), 1.0 if thing.solid else CLEAR)])


def _points(markers: _Markers, thing: Thing, at: Array, colour: Array, known: NDArray[np.bool_]) -> None:
    """Balls, and bars between those that are linked."""
    point, link = thing.radii
    markers.add(thing.name, SPHERE_LIST, (2 * point,) * 3, points=at[known], colors=colour[known])
    pairs = np.array([pair for path in thing.links for pair in pairwise(path)], int).reshape(-1, 2)
    pairs = pairs[known[pairs].all(axis=1)]
    ends = at[pairs].reshape(-1, 3)
    markers.add(thing.name, LINE_LIST, (2 * link, 0, 0), points=ends, colors=_two(colour[pairs[:, 0]]))


def _arrows(markers: _Markers, name: str, rows: Array, colour: Array) -> None:
    for row, one in zip(rows, colour, strict=True):
        thick = 2 * row[6]
        markers.add(name, ARROW, (thick, HEAD * thick, 0.0), colour=one, points=row[:6].reshape(2, 3))


def _capsules(markers: _Markers, name: str, rows: Array, colour: Array) -> None:
    """A cylinder with a ball at each end; without a length, a ball alone.

    Opaque balls of one size are one list. Others are one by one: Foxglove draws each of a list as if it were opaque.
    """
    along = rows[:, 3:6] - rows[:, :3]
    lengths = np.linalg.norm(along, axis=1)
    turns, middles = rotation.from_z(along), (rows[:, :3] + rows[:, 3:6]) / 2
    for i in np.flatnonzero(lengths > 0):
        wide = 2 * rows[i, 6]
        markers.add(name, CYLINDER, (wide, wide, lengths[i]), (*middles[i], *turns[i]), colour[i])
    for radius, chosen in _by_radius(rows[:, 6]):
        long = chosen & (lengths > 0)
        balls = np.concatenate([rows[chosen, :3], rows[long, 3:6]])
        colours = np.concatenate([colour[chosen], colour[long]])
        if (colours[:, 3] == 1.0).all():
            markers.add(name, SPHERE_LIST, (2 * radius,) * 3, points=balls, colors=colours)
            continue
        for ball, one in zip(balls.tolist(), colours, strict=True):
            markers.add(name, SPHERE, (2 * radius,) * 3, (*ball, 1.0, 0.0, 0.0, 0.0), one)


def _by_radius(radii: Array) -> Iterator[tuple[float, NDArray[np.bool_]]]:
    for radius in np.unique(radii):
        yield float(radius), radii == radius


def _ends(rows: Array) -> Array:
    return rows[:, :6].reshape(-1, 3)


def _two(colour: Array) -> Array:
    """Of each of the two ends."""
    return np.repeat(colour, 2, axis=0)
