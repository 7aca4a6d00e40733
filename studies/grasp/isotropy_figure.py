"""The paper's Fig. 3 from our grasps: isotropy over size, in N mm as the paper has it, and by the object's length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.grasp.things import SHAPES
from srl.studies.toolkit.statistics import interval

_LINES: Final = (
    ("human", "human_gii_{}", "0.2", "o-"),
    ("whole hand", "whole_measured_gii_{}", "C0", "s-"),
    ("whole hand, intended", "whole_intended_gii_{}", "C0", "s:"),
    ("partial, thumb and index inactive", "partial_measured_gii_{}", "C1", "^-"),
    ("partial, all close", "partial_all_measured_gii_{}", "C2", "v-"),
    ("human and a random contact", "human_null_{}", "0.6", "x--"),
)
_NAMES: Final = {"mm": "GII, torques in N mm (as the paper)", "l": "GII, torques by the object's length"}


def figure(found: Sequence[Mapping[str, Any]], file: Path, closing: str, radius: bool = False) -> None:
    """Draws the means over placements with their 95 % intervals, and the share in which the finger touches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    picture = Figure(figsize=(12.0, 9.5), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots(3, 3, sharex=True, sharey="row")
    sizes = sorted({one["size"] for one in found})
    for column, shape in enumerate(SHAPES):
        cells = [[one for one in found if (one["shape"], one["size"]) == (shape, size)] for size in sizes]
        for row, unit in enumerate(_NAMES):
            for place, (label, name, colour, style) in enumerate(_LINES):
                values = [[float(one[name.format(unit)]) for one in cell] for cell in cells]
                means = [np.mean(v) if v else np.nan for v in values]
                reach = [(interval(v)[1] - np.mean(v)) if len(v) > 1 else 0.0 for v in values]
                at = 1e3 * np.array(sizes) + 0.6 * (place - 2.5)
                axes[row, column].errorbar(at, means, yerr=reach, fmt=style, color=colour, capsize=2, label=label, ms=4)
        # The two partial ones often coincide: the wider line is below the other.
        for grasp, colour, width in (("whole", "C0", 1.5), ("partial_all", "C2", 4.0), ("partial", "C1", 1.5)):
            for seen, style in (("measured", "-"), ("intended", ":")):
                share = [np.mean([o[f"{grasp}_{seen}_touch"] > 0 for o in c]) if c else np.nan for c in cells]
                axes[2, column].plot(1e3 * np.array(sizes), share, style, marker=".", color=colour, lw=width)
        axes[2, column].set_ylim(-0.03, 1.03)
        axes[0, column].set_title(f"{shape}s")
        axes[2, column].set_xlabel(f"{'radius' if radius else 'diameter'} or edge, mm")
    for row in range(len(_NAMES)):  # once all is drawn: it ends the scaling of the whole row
        axes[row, 0].set_ylim(bottom=0.0)
    for row, text in enumerate([*_NAMES.values(), "share in which the finger touches\n(dotted: intended)"]):
        axes[row, 0].set_ylabel(text)
    picture.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    words = {"curl": "joints curl", "converge": "tips converge on the object"}[closing]
    picture.suptitle(f"Grasp isotropy with and without the sixth finger: {words} (simulated)")
    picture.savefig(file, dpi=110)
