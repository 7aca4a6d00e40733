"""What a layout's signals look like in space: which are shown, where their frames are, and which colours they have.

Every picture of a run goes by this: the recording's views, the page in the browser, the pictures on paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.frames import FrameEntry, as_pose
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import CAPSULE, GAP
from srl.runtime.ipc.layout import Layout

Colors = NDArray[np.uint8]
Color = tuple[int, int, int]
SHADED: Final = ("capsules", "gaps")  # visuals whose colours are those of distances
JOINTED: Final = ("points", "skeleton", "robot")  # visuals that are points, with or without links
# Okabe and Ito's colours without black and the darker blue, for a dark background, then others that differ from them.
PALETTE: Final[tuple[Color, ...]] = (
    *((86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (240, 228, 66), (213, 94, 0)),
    *((150, 120, 245), (150, 205, 70), (0, 200, 205), (190, 140, 95), (245, 130, 130), (200, 206, 212)),
)
PERSON: Final[Color] = (208, 194, 180)  # a person's body, where it is drawn as one
# A distance's colours, from the same set: red touches, yellow is near, green is far. Linear between them.
RAMP: Final = ((0.0, (213, 94, 0)), (0.1, (240, 228, 66)), (0.3, (0, 158, 115)))  # m
UNKNOWN: Final[Color] = (150, 150, 150)  # a distance that isn't known


def visuals(layout: Layout) -> list[Field]:
    """The signals that have a shape in 3D."""
    return [f for f in layout.fields.values() if _shows(f)]


def _shows(f: Field) -> bool:
    """Whether a signal's shape fits its visual."""
    match f.visual:
        case "points" | "skeleton" | "robot":
            return f.shape[1:] == (3,) or f.shape == (3,)
        case "sphere":
            return f.shape == (4,)
        case "path":
            return f.shape in ((3,), (7,))
        case "arrow":
            return f.shape == (2, 3)
        case "capsules":
            return f.shape[1:] == (len(CAPSULE),)
        case "gaps":
            return f.shape[1:] == (len(GAP),)
    return False


def color_numbers(fields: Sequence[Field]) -> dict[str, tuple[int, ...]]:
    """For each signal, the number of its colour, one a row; one alone where all rows have the same.

    Signals take the colours in turn, first those whose rows are grouped: each group takes one. Those that distances
    colour take none.
    """
    found: dict[str, tuple[int, ...]] = {}
    taken = 0
    for field in sorted(fields, key=lambda f: not f.groups):
        names = list(dict.fromkeys(field.groups)) if field.visual in JOINTED else []
        if names and len(field.groups) == field.shape[0]:
            found[field.name] = tuple(taken + names.index(name) for name in field.groups)
        else:
            found[field.name] = (taken,)
        taken += 0 if field.visual in SHADED else max(len(names), 1)
    return found


def colors(numbers: Sequence[int], palette: Sequence[Color] = PALETTE) -> list[Color]:
    """The colours with these numbers; a palette begins anew after its last one."""
    return [palette[number % len(palette)] for number in numbers]


def distance_colors(distances: Array) -> Colors:
    """Colours (..., 3) of distances (...), m, by RAMP; UNKNOWN where one isn't a number."""
    at, stops = np.array([m for m, _ in RAMP]), np.array([color for _, color in RAMP], float)
    found = np.stack([np.interp(distances, at, channel) for channel in stops.T], axis=-1)
    return np.where(np.isfinite(distances)[..., None], found.round(), UNKNOWN).astype(np.uint8)


class Placing:
    """Where the frames of one layout's signals are."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.frames = {n: FrameEntry.recorded(f) for n, f in layout.meta.get("frames", {}).items()}

    def to_root(self, row: NDArray[np.int64], frame: str | None) -> Array:
        """T (4, 4) with p_root = T p_frame, from a row (width,). It is not finite while a pose on the way isn't known.

        A frame that the profile doesn't have counts as the root.
        """
        T = np.eye(4)
        while frame in self.frames:
            entry = self.frames[frame]
            own = homogeneous(entry.placed())
            if entry.pose in self._layout.fields:
                own = own @ homogeneous(as_pose(self._layout.value(row, entry.pose)))
            T, frame = own @ T, entry.parent
        return T
