"""A profile as one picture: on the left its wiring, on the right its frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from runtime.contracts.errors import RequestError
from runtime.recorder import frames_picture, wiring_picture

EDGE, TOP, BELOW = 0.25, 0.55, 0.2  # inches around; for the title
FRAMES, EACH, HEAD = 4.4, 2.9, 0.45  # inches: the frames' width; height of one drawing; of its caption


def draw_overview(overview: Mapping[str, Any], png: Path) -> None:
    """Draws `runtime.profile.overview.overview`. Raises RequestError: the file can't be written."""
    wiring = wiring_picture.laid_out(overview)
    groups = frames_picture.groups(overview)
    right = FRAMES if groups else 0.0
    height = max(wiring.height, len(groups) * (EACH + HEAD), 1.0)
    width = max(wiring.width, 4.0)
    whole = (width + right + 3 * EDGE, height + TOP + BELOW)
    figure = plt.figure(figsize=whole)
    try:
        left = _axes(figure, whole, EDGE, BELOW + height - wiring.height, width, wiring.height)
        left.set_xlim(-0.02, width - 0.02)
        left.set_ylim(wiring.height - 0.3, -0.3)
        left.axis("off")
        wiring_picture.paint(left, wiring)
        share = height / max(len(groups), 1)
        for i, (caption, triads) in enumerate(groups):
            size = (FRAMES, min(share, 1.6 * EACH) - HEAD)
            bottom = BELOW + height - i * min(share, 1.6 * EACH + HEAD) - HEAD - size[1]
            axis = _axes(figure, whole, width + 2 * EDGE, bottom, *size)
            frames_picture.paint(axis, caption, triads, size)
        rate = f"{overview['rate_hz']:g} Hz, clock {overview['clock']}"
        title = f"{overview['profile']}: {overview['summary']}".rstrip(": ")
        figure.text(EDGE / whole[0], 1.0 - 0.2 / whole[1], f"{title}   ({rate})", fontsize=9, va="center")
        figure.savefig(png, dpi=130, format="png")
    except OSError as error:
        problem = f"the picture can't be written: {error.strerror}"
        raise RequestError(str(png), problem, "Choose another place") from None
    finally:
        plt.close(figure)


def _axes(figure: Any, whole: tuple[float, float], x: float, y: float, width: float, height: float) -> Any:
    """Axes at a place that is given in inches."""
    return figure.add_axes((x / whole[0], y / whole[1], width / whole[0], height / whole[1]))
