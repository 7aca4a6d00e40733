"""The report of a glove's calibration: text, figures and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.glove.fit import HIGHEST, LOWEST, Glove
from srl.commissioning.calibration.glove.shapes import shapes
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result


def lines(result: Result[Glove]) -> list[str]:
    """The report as text."""
    glove, options = result.found, result.options
    limits = options.thresholds
    found = [
        f"{options.person}, {options.hand} hand, {options.signal}{result.when}",
        "sensor                   flat  bent  rad/count  noise  uncertain",
    ]
    for i, name in enumerate(glove.sensors):
        offset, bent = glove.offset[i], glove.offset[i] + glove.span[i]
        found.append(
            f"{name:<23} {offset:5.1f} {bent:5.1f}  {glove.gain[i]:9.5f}  {glove.noise[i]:5.2f}  "
            f"{glove.uncertain[i]:.3f} rad"
        )
    if left := [name for name in options.sensors if name in options.plan.left]:
        found.append(f"of an average hand: {', '.join(left)}")
    most = int(np.argmax(glove.again))
    found.append(
        f"flat hand at the end: {glove.again[most]:.3f} rad of {limits.again:g} from the first ({glove.sensors[most]})"
    )
    found.append(
        "the angles are as exact as the hand's in the shapes: a fist that bends 10 % less makes all 10 % great"
    )
    return found


def metrics(result: Result[Glove]) -> dict[str, Any]:
    """The report as JSON types; SI units, and counts."""
    glove, options = result.found, result.options
    return {
        "hand": options.hand, "signal": options.signal,
        "sensors": {
            name: {
                "gain": _number(glove.gain[i]), "offset": float(glove.offset[i]), "span": float(glove.span[i]),
                "noise": float(glove.noise[i]), "uncertain_rad": _number(glove.uncertain[i]),
                "again_rad": _number(glove.again[i]),
            }
            for i, name in enumerate(glove.sensors)
        },
        "average": [name for name in options.sensors if name in options.plan.left],
        "shapes": {
            shape.name: dict(zip(glove.sensors, glove.held[number].mean.tolist(), strict=True))
            for number, shape in shapes(options.angles).items()
        },
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def draw(result: Result[Glove], png: Path) -> None:
    """Draws each sensor's counts in the shapes, and how far each is bent in each. Raises RecordError."""
    glove, every = result.found, shapes(result.options.angles)
    names, rows = glove.sensors, np.arange(len(glove.sensors))
    figure, (counts, bent) = plt.subplots(
        1, 2, figsize=(13, 1.5 + 0.3 * len(names)), constrained_layout=True, sharey=True
    )
    for edge in (LOWEST, HIGHEST):
        counts.axvline(edge, color="#D55E00", linestyle="--")
    for held in glove.held.values():
        counts.hlines(rows, held.least, held.greatest, color="0.8", linewidth=4)
        counts.plot(held.mean, rows, ".", color="0.5", markersize=4)
    counts.plot(glove.offset, rows, "o", color="#0072B2", label="flat")
    counts.plot(glove.offset + glove.span, rows, "s", color="#009E73", label="bent")
    counts.set_yticks(rows, names, fontsize=8)
    counts.invert_yaxis()
    counts.set_xlabel("counts in all shapes; dashed: ends of the scale")
    counts.legend(fontsize=8)
    table = np.array([glove.shares(number) for number in every]).T
    shown = bent.imshow(np.nan_to_num(table), vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
    for i, j in np.ndindex(table.shape):
        colour = "white" if abs(table[i, j]) > 0.6 else "black"
        bent.text(j, i, f"{table[i, j].round(1) + 0.0:.1f}", ha="center", va="center", fontsize=7, color=colour)
    bent.set_xticks(range(len(every)), [shape.name for shape in every.values()], rotation=30, fontsize=8)
    bent.set_title("share of the calibrating bend, by shape", fontsize=9)
    figure.colorbar(shown, ax=bent, shrink=0.6)
    figure.suptitle(lines(result)[0], fontsize=9)
    save(figure, png)
