"""The paper's Fig. 14 of one simulated trial: the flange's path, forces and positions, coloured by mode."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from matplotlib.figure import Figure

from srl.runtime.contracts.signals import Array

_VIOLET: Final = "#7b4fa3"
_YELLOW: Final = "#e0b400"
_BLUE: Final = "#56B4E9"
_PURPLE: Final = "#CC79A7"


def draw(row: Mapping[str, Any], series: Mapping[str, Any], a: Mapping[str, Any], file: Path) -> None:
    """Draws left the flange's path, right forces and positions.

    Args:
        row, series: of a trial, as load_trial gives them.
        a: the assumptions.
        file: the picture.
    """
    figure = Figure(figsize=(12, 6.5), layout="constrained")
    left, right = cast(Any, figure.subfigures(1, 2, width_ratios=(1, 1.15)))
    t, at, force, mode = (np.array(series[name]) for name in ("t", "at", "force", "locomotion"))
    _path(left, t, at, mode, row, a)
    _series(right, t, force, at, mode, row)
    figure.suptitle(f"Load carrying, simulated: Kairos, {a['mass']:g} kg")
    figure.savefig(file, dpi=110)


def _path(figure: Any, t: Array, at: Array, mode: Any, row: Mapping[str, Any], a: Mapping[str, Any]) -> None:
    axes = figure.add_subplot(projection="3d")
    for begin, end in _spans(mode):
        axes.plot(*at[begin : end + 1].T, color=_YELLOW if mode[begin] else _VIOLET)
    for when, color, word in ((row["taken"], _BLUE, "pick"), (row["placed"], _PURPLE, "place")):
        if when is not None:
            axes.scatter(*at[min(int(np.searchsorted(t, when)), len(at) - 1)], color=color, s=60, label=word)
    for color, word in ((_VIOLET, "manipulation"), (_YELLOW, "locomotion")):
        axes.plot([], [], [], color=color, label=word)
    for box in a["obstacles"]:
        (x, y, z), (w, d, h) = box["position"], box["size"]
        axes.bar3d(x - w / 2, y - d / 2, z - h / 2, w, d, h, color="0.7", alpha=0.3)
    low, high = at.min(axis=0), at.max(axis=0)
    middle, half = (low + high) / 2, float((high - low).max()) / 2 + 0.2
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_zlim(0.0, 1.6)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_zlabel("z (m)")
    axes.set_title("the flange's way; obstacles grey")
    axes.legend(loc="upper left", fontsize=8)


def _series(figure: Any, t: Array, force: Array, at: Array, mode: Any, row: Mapping[str, Any]) -> None:
    rows = figure.subplots(2, 1, sharex=True)
    for axes, values, unit in ((rows[0], force, "force at the flange (N)"), (rows[1], at, "flange (m)")):
        for k, (axis, color) in enumerate(zip("xyz", ("#0072B2", "#009E73", "#D55E00"), strict=True)):
            axes.plot(t, values[:, k], color=color, lw=1, label=axis)
        for begin, end in _spans(mode):
            axes.axvspan(t[begin], t[end], color=_YELLOW if mode[begin] else _VIOLET, alpha=0.15, lw=0)
        for started, ended, color in (
            (row["taken"], row["lifted"], _BLUE), (row["lowered"], row["placed"], _PURPLE)
        ):  # fmt: skip
            if started is not None and ended is not None:
                axes.axvspan(started, ended, color=color, alpha=0.5, lw=0)
        axes.set_ylabel(unit)
        axes.legend(loc="upper right", fontsize=8, ncols=3)
    rows[0].axhline(0.0, color="0.6", lw=0.5)
    rows[1].set_xlabel("s; violet manipulation, yellow locomotion, blue grasp and lift, purple placing")


def _spans(flags: Any) -> list[tuple[int, int]]:
    """Returns index pairs of runs of equal flags; each run ends where the next begins."""
    cuts = [0, *(np.flatnonzero(flags[1:] != flags[:-1]) + 1).tolist(), len(flags) - 1]
    return [(a, b) for a, b in pairwise(cuts) if b > a]
