"""The tree of frames as a picture: a triad of axes for each frame, at the profile's own numbers.

What hangs on a link that moves, or on a body of a simulated part, is drawn by itself: no number says where that is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.rotation import Pose, composed, homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.pictures.naming import HALO, write_names

Item = Mapping[str, Any]
AXES = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
EYES = list(product((-60.0, -35.0, -115.0, 35.0), (22.0, 35.0)))  # azimuth and elevation, degrees
ALONE = 0.1  # m, the axes of a frame without others
OF_SPAN, OF_NEAREST, SHORT = 0.2, 0.6, 0.06  # the axes' length: of the largest distance, of the least; at least
NEAR = 0.004  # of the largest distance: nearer frames are drawn as at one place
MOST, LETTERS = 5, 32  # lines of names at one place; letters of a name
SHORTER = 0.62  # each further triad at the same place, of the one before


def groups(overview: Item) -> tuple[list[tuple[str, list[tuple[str, Pose, int]]]], list[str]]:
    """The drawings: a caption, and of each triad its name, pose in the root, and the number of its parent (-1: none).

    A frame that has no other one in its drawing is left out where there are drawings of more: their names.
    """
    found = []
    for root in dict.fromkeys(frame["root"] for frame in overview["frames"]):
        members = [frame for frame in overview["frames"] if frame["root"] == root]
        triads: list[tuple[str, Pose, int]] = []
        numbers: dict[str, int] = {}
        for frame in members:
            numbers[frame["name"]] = len(triads)
            parent = numbers.get(frame["parent"], -1)
            by = f" (by {frame['measured_by']})" if frame["measured_by"] else ""
            triads.append((frame["name"] + by, _pose(frame["pose_in_root"]), parent))
        for frame in members:
            for part in frame["parts"]:
                pose = _pose(part["pose"])
                if pose != IDENTITY:
                    placed = composed(_pose(frame["pose_in_root"]), pose)
                    triads.append((f"part {part['name']}", placed, numbers[frame["name"]]))
        found.append((_caption(members[0], members), triads))
    several = [each for each in found if len(each[1]) > 1]
    alone = [triads[0][0] for _, triads in found if len(triads) == 1] if several else []
    return several or found, alone


def _caption(root: Item, members: Sequence[Item]) -> str:
    owner = root["name"].partition("/")[0]
    moves = {"link": f", which moves with the joints of {owner}", "body": f", a body of the simulated part {owner}"}
    measured = "; measured frames where zero is measured" if any(frame["measured_by"] for frame in members) else ""
    return f"in {root['name']}{moves.get(root['kind'], '')}{measured}"


def _pose(values: Sequence[float]) -> Pose:
    x, y, z, *turn = map(float, values)
    return (x, y, z, turn[0], turn[1], turn[2], turn[3])


def paint(axis: Any, caption: str, triads: Sequence[tuple[str, Pose, int]], size: tuple[float, float]) -> None:
    """Draws one of the `groups` on an axis of this size, inches, that has its final place."""
    matrices = np.stack([homogeneous(pose) for _, pose, _ in triads])
    places = matrices[:, :3, 3]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    span = float(apart.max())
    nearest = float(apart[apart > NEAR * span].min(initial=span))
    length = float(np.clip(OF_NEAREST * nearest, SHORT * span, OF_SPAN * span)) if span > 0.0 else ALONE
    same = [[j for j in range(i) if np.linalg.norm(places[i] - places[j]) <= NEAR * span] for i in range(len(triads))]
    lengths = [length * SHORTER ** len(before) for before in same]
    tips = places[:, None] + np.array(lengths)[:, None, None] * np.swapaxes(matrices[:, :3, :3], 1, 2)
    flat = _camera(places, span)
    at, ends, letters = flat(places), flat(tips), flat(places[:, None] + 1.25 * (tips - places[:, None]))
    _fit(axis, np.concatenate([at, letters.reshape(-1, 2)]), size)
    # A measured frame at zero lies on its parent, turned as it: one triad stands for both.
    like = [any(np.allclose(matrices[i, :3, :3], matrices[j, :3, :3]) for j in same[i]) for i in range(len(triads))]
    for i, (_, _, parent) in enumerate(triads):
        if parent >= 0:
            axis.plot(*np.stack([at[parent], at[i]]).T, color="0.6", linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)
        for j, (name, color) in enumerate(AXES.items() if not like[i] else ()):
            axis.plot(*np.stack([at[i], ends[i, j]]).T, color=color, linewidth=1.6 + 0.8 * len(same[i]), zorder=3,
                      solid_capstyle="butt", alpha=0.9)  # fmt: skip
            way = axis.transData.transform(ends[i, j]) - axis.transData.transform(at[i])
            if np.linalg.norm(ends[i, j] - at[i]) > 0.2 * lengths[i]:  # else it points at the eye
                along = 6.0 * way / np.linalg.norm(way)
                shift = along if not same[i] else np.array([-along[1], along[0]])  # beside the longer axis
                axis.annotate(
                    name, ends[i, j], tuple(shift), textcoords="offset points", fontsize=6.5, color=color, ha="center",
                    va="center", path_effects=HALO, zorder=4,
                )  # fmt: skip
    firsts = [i for i, before in enumerate(same) if not before]
    within = ["", " (shorter axes)", " (shortest axes)"]
    names = [
        _listed(
            _short(triads[j][0]) + within[0 if like[j] else min(len(same[j]), 2)]
            for j in range(len(triads))
            if j == i or i in same[j]
        )
        for i in firsts
    ]
    lines = [np.stack([at[i], letters[i, j]]) for i in range(len(triads)) for j in range(3)]
    lines += [np.stack([at[parent], at[i]]) for i, (_, _, parent) in enumerate(triads) if parent >= 0]
    axis.set_title(f"{caption}\naxes {1000.0 * length:.3g} mm long", fontsize=7, color="0.3")
    write_names(axis, names, at[firsts], lines)


def _listed(names: Iterable[str]) -> str:
    """A line for each name, as far as there is room: the text of `srl check --all` has all."""
    lines = list(names)
    if len(lines) > MOST:
        lines[MOST - 1 :] = [f"and {len(lines) - MOST + 1} more"]
    return "\n".join(lines)


def _short(name: str) -> str:
    return name if len(name) <= LETTERS else f"{name[: LETTERS - 3]}..."


def _camera(places: Array, span: float) -> Any:
    """The parallel projection (..., 3) -> (..., 2) in which the frames are farthest apart."""
    one, other = np.triu_indices(len(places), 1)
    apart = places[one] - places[other]
    apart = apart[np.linalg.norm(apart, axis=1) > NEAR * span]

    def least(camera: tuple[float, float]) -> float:
        return float(np.linalg.norm(apart @ _plane(*camera), axis=1).min(initial=np.inf))

    plane = _plane(*max(EYES, key=least))
    return lambda points: points @ plane


def _plane(azimuth: float, elevation: float) -> Array:
    """(3, 2): right and up of one who looks at the origin from there; z is up."""
    a, e = np.deg2rad([azimuth, elevation])
    right = [-np.sin(a), np.cos(a), 0.0]
    up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
    return np.array([right, up]).T


def _fit(axis: Any, points: Array, size: tuple[float, float]) -> None:
    """Limits with one scale for both directions and room for names."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.array(size) - (1.6, 0.8)  # inches for what is drawn; names are beside it
    scale = max(float(((high - low) / room).max()), 1e-6)  # m an inch
    middle, half = (low + high) / 2.0, scale * np.array(size) / 2.0
    axis.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axis.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axis.axis("off")
