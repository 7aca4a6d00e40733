"""A row's picture in two kinds of things: points with links, and capsules. All in the root frame.

For pictures that aren't rerun's, which has more kinds of its own: the page in the browser and pictures on paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.linkage import Solid
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.link_capsules import link_capsules
from srl.runtime.recording.person import thicknesses
from srl.runtime.recording.robots import FixedRobots
from srl.runtime.recording.shapes import JOINTED, SHADED, Placing, color_numbers, visuals

THICK: Final = {"points": (0.004, 0.0025), "skeleton": (0.009, 0.006), "robot": (0.03, 0.02)}  # m, radii: point, link
GAP, ARROW, DOT = 0.003, 0.008, 0.012  # m, radii
NEWTON: Final = 0.02  # m, length of an arrow for each newton


@dataclass(frozen=True)
class Thing:
    """The shape of one signal, or of one robot.

    Attributes:
        name: the signal, or the robot's device.
        points: whether it is points with links. Otherwise it is capsules.
        numbers: of its colours, one a row or one for all; empty where the distance gives the colours.
        labels, links, groups: of its rows.
        radii: m, of a point and of a link; of points only.
        solid: whether one can't see through it.
        law: whether a law gives it: while the limb isn't active no law runs, and it stays as it was.
        thick: m, of its rows, where they are a person's joints: how thick the body is there; None for others. Empty:
            none is.
        parts: of a robot: its solids, each with the number of its link.
    """

    name: str
    points: bool
    numbers: tuple[int, ...]
    labels: tuple[str, ...] = ()
    links: tuple[tuple[int, ...], ...] = ()
    groups: tuple[str, ...] = ()
    radii: tuple[float, float] = (0.0, 0.0)
    solid: bool = False
    law: bool = False
    thick: tuple[float | None, ...] = ()
    parts: tuple[tuple[int, Solid], ...] = ()


class Solids:
    """The things of one layout.

    Attributes:
        things: in the order of their signals; then the robots, by the names of their devices.
    """

    def __init__(self, layout: Layout, with_robots: bool = True) -> None:
        """`with_robots`: False where something else draws them."""
        self._layout = layout
        self._standing = FixedRobots(layout)
        self._fields = [field for field in visuals(layout) if field.name not in self._standing.hidden]
        self._placing = Placing(layout)
        numbers = color_numbers(self._fields)
        self.things = [
            replace(_thing(field, numbers[field.name]), law=field.role == "internal") for field in self._fields
        ]
        taken = (number for f in self._fields if f.visual not in SHADED for number in numbers[f.name])
        first = 1 + max(taken, default=-1)
        drawn = self._standing.robots if with_robots else []
        self.things += [
            Thing(robot.name, False, (first + i,), solid=True, parts=tuple(
                (number, solid) for number, link in enumerate(robot.linkage.links) for solid in link.solids
            ))
            for i, robot in enumerate(drawn)
        ]  # fmt: skip
        self._links = [link_capsules(robot.linkage) for robot in drawn]

    def links(self, row: NDArray[np.int64]) -> list[Array]:
        """(n, 4, 4) of each robot, the last of the things: its links in the root frame, m, in a row (width,)."""
        return self._standing.of(row) if self._links else []

    def of(self, row: NDArray[np.int64], links: Sequence[Array] | None = None) -> list[Array]:
        """What each thing is in a row (width,): points (k, 3), or capsules (k, 8) as terms.CAPSULE says, m.

        What isn't known isn't finite. `links`: what `links` gave for this row, if it was asked already.
        """
        known: dict[str | None, Array] = {}
        found = []
        for field, thing in zip(self._fields, self.things, strict=False):  # the robots come after
            if field.frame not in known:
                known[field.frame] = self._placing.to_root(row, field.frame)
            T, values = known[field.frame], self._layout.value(row, field.name)
            rows = (values.reshape(-1, 3) if thing.points else _capsules(field, values)).copy()
            if thing.points and len(rows) > 1 and not rows.any():
                rows[:] = np.nan  # no sample yet
            for at in (0,) if thing.points else (0, 3):
                rows[:, at : at + 3] = rows[:, at : at + 3] @ T[:3, :3].T + T[:3, 3]
            found.append(rows)
        placed = self.links(row) if links is None else links
        for places, (numbers, shapes) in zip(placed, self._links, strict=True):
            T, rows = places[numbers], shapes.copy()
            for at in (0, 3):
                rows[:, at : at + 3] = (T[:, :3, :3] @ rows[:, at : at + 3, None])[..., 0] + T[:, :3, 3]
            found.append(rows)
        return found


def _thing(field: Field, numbers: tuple[int, ...]) -> Thing:
    if field.visual in JOINTED:
        labels = field.labels if len(field.shape) > 1 else ()
        thick = thicknesses(labels) if field.visual == "skeleton" and field.role != "truth" else ()
        return Thing(
            field.name, True, numbers, labels, field.links, field.groups, THICK[field.visual], True, thick=thick
        )
    shaded = field.visual in SHADED
    clear = field.visual in ("capsules", "sphere")
    return Thing(field.name, False, () if shaded else numbers, field.labels if shaded else (), solid=not clear)


def _capsules(field: Field, values: Array) -> Array:
    """(k, 8), in the signal's own frame."""
    match field.visual:
        case "capsules":
            return values
        case "gaps":
            return np.insert(values, 6, GAP, axis=1)
        case "sphere":
            return np.array([[*values[:3], *values[:3], values[3], np.nan]])
        case "arrow":
            return np.array([[*values[0], *(values[0] + NEWTON * values[1]), ARROW, np.nan]])
    at = values[:3] if values.any() else np.full(3, np.nan)  # a path without a sample yet
    return np.array([[*at, *at, DOT, np.nan]])
