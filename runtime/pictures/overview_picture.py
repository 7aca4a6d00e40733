"""A profile as one picture: on the left its wiring, on the right its frames."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from srl.runtime.contracts import whole_file
from srl.runtime.contracts.errors import RequestError
from srl.runtime.pictures import frames_picture, wiring_picture

EDGE, TOP, BELOW = 0.25, 0.5, 0.3  # inches around; for the title
FRAMES, EACH, HEAD = 4.2, 2.6, 0.4  # inches: the frames' width; height of one drawing, at least; of its caption
TALL = 3.6  # inches: height of one drawing, at most
FONT = 9.0  # points, of the title
STROKE = 0.05  # inches that a box's edge needs


def draw_overview(overview: Mapping[str, Any], png: Path) -> None:
    """Draws `srl.runtime.overview.overview.overview`. Raises RequestError: the file can't be written."""
    drawn = BytesIO()
    with mpl.rc_context({"text.parse_math": False}):  # a name with dollars is no formula
        _draw(overview, drawn)
    whole_file.write(png, drawn.getvalue(), RequestError)


def _draw(overview: Mapping[str, Any], png: BytesIO) -> None:
    wiring = wiring_picture.laid_out(overview)
    groups, alone = frames_picture.groups(overview)
    right = FRAMES if groups else 0.0
    height = max(wiring.height + STROKE, len(groups) * (EACH + HEAD))
    rate = f"{overview['rate_hz']:g} Hz, clock {overview['clock']}"
    title = f"{overview['profile']}: {overview['summary']}".rstrip(": ") + f"   ({rate})"
    width = max(wiring.width + 2 * STROKE, wiring_picture.long(title, FONT) - right)
    whole = (width + right + 3 * EDGE, height + TOP + BELOW)
    figure = plt.figure(figsize=whole)
    try:
        tall = wiring.height + STROKE
        left = _axes(figure, whole, EDGE, BELOW + height - tall, width, tall)
        left.set_xlim(-STROKE, width - STROKE)
        left.set_ylim(tall - wiring_picture.ABOVE, -wiring_picture.ABOVE)
        left.axis("off")
        wiring_picture.paint(left, wiring)
        each = min(height / max(len(groups), 1), TALL + HEAD)
        for i, (caption, triads) in enumerate(groups):
            size = (FRAMES, each - HEAD)
            axis = _axes(figure, whole, width + 2 * EDGE, BELOW + height - (i + 1) * each, *size)
            frames_picture.paint(axis, caption, triads, size)
        if alone:
            words = f"frames without another that is fixed to them: {', '.join(alone)}"
            lines = textwrap.fill(words, 76, break_on_hyphens=False)
            figure.text(1.0 - EDGE / whole[0], 0.08 / whole[1], lines, fontsize=6.5, ha="right", color="0.4")
        figure.text(EDGE / whole[0], 1.0 - 0.2 / whole[1], title, fontsize=FONT, va="center")
        figure.savefig(png, dpi=130, format="png")
    finally:
        plt.close(figure)


def _axes(figure: Any, whole: tuple[float, float], x: float, y: float, width: float, height: float) -> Any:
    """Axes at a place that is given in inches."""
    return figure.add_axes((x / whole[0], y / whole[1], width / whole[0], height / whole[1]))
