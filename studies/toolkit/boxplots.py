"""Boxplots of paired conditions: quartiles, whiskers, every subject's point, stars of the sign test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from srl.runtime.contracts.signals import Array
from srl.studies.toolkit.errors import StudyError, exactly, pairs
from srl.studies.toolkit.statistics import Box, box, sign_test, stars

# Two of Okabe and Ito's colours. Conditions also differ in position, so a grey print is readable.
COLORS: Final = ("#0072B2", "#E69F00")
_APART: Final = 0.19  # half the distance between a group's two boxes
_WIDTH: Final = 0.3
Groups = Mapping[str, Mapping[str, Sequence[float]]]


def draw(
    groups: Groups,
    conditions: tuple[str, str],
    file: Path,
    *,
    title: str,
    unit: str,
    names: Mapping[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> dict[tuple[str, str], Box]:
    """Draws two boxes per group (a subscale, a muscle) and returns what was drawn.

    The line in a box is the median, its ends are the quartiles. Whiskers reach the outermost values within 1.5
    interquartile ranges. Each dot is a subject, including outliers. Stars: p of the exact sign test below 0.05,
    0.01, 0.001.

    Args:
        groups: values by group and condition; the same subject at the same index.
        conditions: two of them.
        file: its extension determines the format (.png, .svg, .pdf).
        title, unit: of the picture and of the values.
        names: of the groups, if they differ from the keys.
        limits: of the values, if the scale has ends; stars stand above.

    Raises:
        StudyError: there are no groups, a condition is missing, values don't pair, or the file can't be written.
    """
    if not groups:
        raise StudyError(title, "there is nothing to draw", "Give at least one group")
    width = 1.6 + 1.5 * len(groups)  # inches
    figure = Figure(figsize=(width, 4.2), layout="constrained")
    axis = figure.add_subplot()
    drawn: dict[tuple[str, str], Box] = {}
    marks: dict[int, str] = {}
    for at, (group, by_condition) in enumerate(groups.items()):
        place = f"{title}: {group}"
        exactly(place, by_condition, conditions, "condition")
        both = pairs(place, by_condition[conditions[0]], by_condition[conditions[1]])
        for condition, values, color, side in zip(conditions, both, COLORS, (-_APART, _APART), strict=True):
            found = drawn[group, condition] = box(values, f"{place}, {condition}")
            _box(axis, found, at + side, color)
            axis.scatter(at + side + _spread(values), values, s=14, color="#333333", alpha=0.75, linewidths=0, zorder=3)
        marks[at] = stars(sign_test(*both, place).p)
    if limits is not None:
        axis.set_ylim(*limits)
    low, high = axis.get_ylim()
    axis.set_ylim(low - 0.02 * (high - low), high + 0.08 * (high - low))  # no dot is cut; room for the stars
    for at, mark in marks.items():
        if mark:
            y = high + 0.015 * (high - low)
            axis.plot([at - _APART, at + _APART], [y, y], color="#333333", linewidth=0.9)
            axis.text(at, y, mark, ha="center", va="bottom", fontsize=11)
    axis.set_xticks(range(len(groups)), [(names or {}).get(g, g.replace("_", "\n")) for g in groups], fontsize=9)
    axis.set_xlim(-0.6, len(groups) - 0.4)
    axis.set_ylabel(unit, fontsize=9)
    axis.tick_params(labelsize=8)
    axis.grid(axis="y", color="#dddddd", linewidth=0.5)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    for condition, color in zip(conditions, COLORS, strict=True):
        axis.fill_between([], [], color=color, alpha=0.55, label=condition)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    figure.suptitle(fill(title, round(11 * width)), fontsize=11)
    try:
        figure.savefig(file, dpi=130)
    except (OSError, ValueError) as error:
        raise StudyError(str(file), f"the picture can't be written: {error}", "Choose another file") from None
    return drawn


def _box(axis: Any, found: Box, x: float, color: str) -> None:
    stats = {
        "med": found.median,
        "q1": found.lower,
        "q3": found.upper,
        "whislo": found.low,
        "whishi": found.high,
        "fliers": [],  # they are drawn as dots
    }
    axis.bxp(
        [stats],
        positions=[x],
        widths=_WIDTH,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": color, "alpha": 0.55, "linewidth": 0.9},
        medianprops={"color": "#111111", "linewidth": 1.8},
        whiskerprops={"linewidth": 0.9},
        capprops={"linewidth": 0.9},
    )


def _spread(values: Array) -> Array:
    """Returns the sideways positions of the dots (n,): equal values side by side, other values in the middle."""
    places = np.zeros(len(values))
    step = _WIDTH / 8
    for value in np.unique(values):
        same = np.flatnonzero(values == value)
        fit = min(step, 0.8 * _WIDTH / max(len(same) - 1, 1))
        places[same] = fit * (np.arange(len(same)) - (len(same) - 1) / 2)
    return places
