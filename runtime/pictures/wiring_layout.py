"""Where the boxes and arrows of a wiring's picture lie: columns from what measures to what moves.

An arrow that passes a column has a slot of its own in it, so no arrow goes through a box (the layered drawing of
Sugiyama, Tagawa and Toda, 1981). All lengths are inches, y downwards from the top.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from srl.runtime.contracts.signals import Array

ROW, HEAD, NOTE = 0.165, 0.25, 0.14  # of a port, a title, a line of notes
SLOT, APART = 0.10, 0.17  # height of an arrow that passes; between two boxes
GAP, MORE = 0.55, 0.022  # between two columns, and more for each arrow between them
SWEEPS = 24


@dataclass(eq=False)
class Box:
    """One box, or (`title` "") the slot of an arrow that passes its column.

    Attributes:
        title: its first line.
        kind: "source", "law", "guard", "device", "slot".
        left, right: labels of the ports by their keys, from the top.
        notes: lines below the ports.
        column: from the left.
        x, y, width, height: of its upper left corner, and its size.
    """

    title: str
    kind: str
    left: dict[str, str] = field(default_factory=dict)
    right: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    column: int = 0
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    height: float = 0.0

    def size(self) -> float:
        """Its height."""
        if self.kind == "slot":
            return SLOT
        return HEAD + ROW * max(len(self.left), len(self.right)) + NOTE * len(self.notes) + 0.06

    def port(self, side: str, key: str) -> float:
        """How far below its upper edge a port of "left" or "right" is."""
        if self.kind == "slot":
            return SLOT / 2.0
        return HEAD + ROW * (list(getattr(self, side)).index(key) + 0.5)


@dataclass(frozen=True)
class Arrow:
    """A piece of an arrow from the right port of a box to the left port of one in the next column.

    `signal` is the key of the port where the whole arrow begins; `source` is the box there.
    """

    start: Box
    begin: str
    end: Box
    at: str
    signal: str
    source: Box


def columns(boxes: Sequence[Box], wires: Iterable[tuple[Box, str, Box, str]]) -> tuple[list[list[Box]], list[Arrow]]:
    """Orders the boxes, adds the slots, and sets `x` and `y` of all. Their `column` and `width` must be set.

    Args:
        boxes: in the order that is kept where nothing speaks against it.
        wires: (box, its right port, box, its left port); the second box's column is a later one.
    Returns:
        The boxes and slots of each column from the top, and all pieces of arrows.
    """
    made: list[list[Box]] = [[] for _ in range(1 + max((box.column for box in boxes), default=0))]
    for box in boxes:
        box.height = box.size()
        made[box.column].append(box)
    arrows: list[Arrow] = []
    slots: dict[tuple[Box, str, int], Box] = {}
    for start, begin, end, at in wires:
        here, key = start, begin
        for column in range(start.column + 1, end.column):
            slot = slots.get((start, begin, column))
            if slot is None:
                slot = slots[start, begin, column] = Box("", "slot", {"": ""}, {"": ""}, column=column, height=SLOT)
                made[column].append(slot)
                arrows.append(Arrow(here, key, slot, "", begin, start))
            here, key = slot, ""
        arrows.append(Arrow(here, key, end, at, begin, start))
    _order(made, arrows)
    _place(made, arrows)
    return made, arrows


def _order(made: list[list[Box]], arrows: Sequence[Arrow]) -> None:
    """Sorts each column by where its arrows come from and go to; keeps the order with the fewest crossings."""
    best, least = [list(column) for column in made], _crossings(made, arrows)
    for sweep in range(SWEEPS):
        forward = sweep % 2 == 0
        for column in made if forward else reversed(made):
            rank = _ranks(made)
            wish = {box: _wish(box, arrows, rank, forward) for box in column}
            column.sort(key=wish.__getitem__)
        if (count := _crossings(made, arrows)) < least:
            best, least = [list(column) for column in made], count
    for column, order in zip(made, best, strict=True):
        column[:] = order


def _ranks(made: Sequence[Sequence[Box]]) -> dict[Box, float]:
    """From 0 at the top of a column to 1 at its end."""
    return {box: (i + 0.5) / len(column) for column in made for i, box in enumerate(column)}


def _wish(box: Box, arrows: Sequence[Arrow], rank: Mapping[Box, float], forward: bool) -> float:
    """The mean place of what its arrows come from, or go to; its own where it has none."""
    ends = [
        rank[a.start if forward else a.end]
        + 0.01 * (a.start.port("right", a.begin) if forward else a.end.port("left", a.at))
        for a in arrows
        if (a.end if forward else a.start) is box
    ]
    return sum(ends) / len(ends) if ends else rank[box]


def _crossings(made: Sequence[Sequence[Box]], arrows: Sequence[Arrow]) -> int:
    rank = {box: i for column in made for i, box in enumerate(column)}
    ends = [
        (a.start.column, rank[a.start] + 0.1 * a.start.port("right", a.begin) / 10.0,
         rank[a.end] + 0.1 * a.end.port("left", a.at) / 10.0)
        for a in arrows
    ]  # fmt: skip
    return sum((a[1] - b[1]) * (a[2] - b[2]) < 0.0 for i, a in enumerate(ends) for b in ends[i + 1 :] if a[0] == b[0])


def _place(made: Sequence[Sequence[Box]], arrows: Sequence[Arrow]) -> None:
    x = 0.0
    for i, column in enumerate(made):
        width = max((box.width for box in column), default=0.0)
        for box in column:
            box.x, box.width = x, width
        between = len({(a.source, a.signal) for a in arrows if a.start.column == i})
        x += width + GAP + MORE * between
    for column in made:
        _settle(column, np.zeros(len(column)))
    for sweep in range(SWEEPS):
        for column in made if sweep % 2 == 0 else reversed(made):
            _settle(column, np.array([_level(box, arrows) for box in column]))
    top = min((box.y for column in made for box in column), default=0.0)
    for column in made:
        for box in column:
            box.y -= top


def _level(box: Box, arrows: Sequence[Arrow]) -> float:
    """Where its upper edge makes its arrows level, in the mean."""
    wish = [a.start.y + a.start.port("right", a.begin) - box.port("left", a.at) for a in arrows if a.end is box]
    wish += [a.end.y + a.end.port("left", a.at) - box.port("right", a.begin) for a in arrows if a.start is box]
    return float(np.mean(wish)) if wish else box.y


def _settle(column: Sequence[Box], wish: Array) -> None:
    """Places boxes one below the other, as near to the upper edges they wish for as there is room (pooled means)."""
    above = np.cumsum([0.0, *(_step(a, b) for a, b in pairwise(column))])
    pools: list[list[float]] = []  # sum, count
    for value in wish - above[: len(column)]:
        pools.append([float(value), 1.0])
        while len(pools) > 1 and pools[-2][0] / pools[-2][1] > pools[-1][0] / pools[-1][1]:
            last = pools.pop()
            pools[-1] = [pools[-1][0] + last[0], pools[-1][1] + last[1]]
    levels = [total / count for total, count in pools for _ in range(int(count))]
    for box, level, offset in zip(column, levels, above, strict=False):
        box.y = level + float(offset)


def _step(a: Box, b: Box) -> float:
    """From the upper edge of a box to that of the next one."""
    both_pass = a.kind == b.kind == "slot"
    return a.height + (0.02 if both_pass else APART)
