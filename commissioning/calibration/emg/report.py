"""The report of a calibration of surface EMG: text, figures and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.emg.fit import Mvc
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result


def lines(result: Result[Mvc]) -> list[str]:
    """The report as text."""
    found, options = result.found, result.options
    filters = options.plan.filters()
    text = [
        f"{options.person}, {options.signal}{result.when}",
        "muscle                  rest uV   MVC uV  contractions uV               differ  hum at rest",
    ]
    for i, name in enumerate(found.muscles):
        own = found.own[i]
        each = " ".join(f"{1e6 * level:7.1f}" for level in own)
        differ = 1.0 - own.min() / own.max() if own.max() else 1.0
        text.append(
            f"{name:<22} {1e6 * found.rest[i]:8.2f} {1e6 * found.mvc[i]:8.1f}  {each:<29} {differ:5.0%}  "
            f"{found.hum[i]:5.0%} ({found.mains[i]:.0f} Hz)"
        )
    top = found.levels.max(axis=1)
    for j, name in enumerate(found.muscles):
        i = int(top[:, j].argmax())
        if i != j:
            text.append(f"{name}: its MVC is from the contraction of {found.muscles[i]}, which gave more than its own")
    low, high = filters.band
    text.append(
        f"band {low:g} to {high:g} Hz, envelope {filters.cutoff:g} Hz (late by {1e3 * filters.delay:.0f} ms), MVC: "
        f"highest mean over {options.plan.window:g} s; it holds while the electrodes stay on the skin"
    )
    return text


def metrics(result: Result[Mvc]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    found, options = result.found, result.options
    top = found.levels.max(axis=1)
    return {
        "signal": options.signal,
        "muscles": {
            name: {
                "rest": float(found.rest[i]), "mvc": float(found.mvc[i]), "repeats": found.own[i].tolist(),
                "in_others": {
                    other: float(top[k, i]) for k, other in enumerate(found.muscles) if k != i
                },
                "hum": float(found.hum[i]), "mains_hz": float(found.mains[i]), "at_end": int(found.clipped[i]),
            }
            for i, name in enumerate(found.muscles)
        },
    }  # fmt: skip


def draw(result: Result[Mvc], png: Path) -> None:
    """Draws each muscle's envelopes in its contractions, and what all give in each. Raises RecordError."""
    found = result.found
    n = len(found.muscles)
    figure = plt.figure(figsize=(12, 2.0 + 1.6 * n), constrained_layout=True)
    grid = figure.add_gridspec(n, 2, width_ratios=(2, 1))
    for i, name in enumerate(found.muscles):
        axes = figure.add_subplot(grid[i, 0])
        for (muscle, j), envelope in found.envelopes.items():
            if muscle == i:
                axes.plot(np.arange(len(envelope)) / found.rate, 1e6 * envelope, linewidth=0.8, label=f"{j + 1}")
        axes.axhline(1e6 * found.mvc[i], color="#D55E00", linestyle="--", label="MVC")
        axes.axhline(1e6 * found.rest[i], color="0.5", linestyle=":", label="rest")
        axes.set_ylabel(f"{name}\nuV", fontsize=8)
        axes.set_ylim(bottom=0.0)
        axes.legend(fontsize=7, ncols=5, loc="lower right")
    axes.set_xlabel("s")
    shares = found.levels.max(axis=1) / np.where(found.mvc > 0.0, found.mvc, np.inf)
    table = figure.add_subplot(grid[:, 1])
    shown = table.imshow(shares, vmin=0.0, vmax=1.0, cmap="viridis", aspect="auto")
    for i, j in np.ndindex(shares.shape):
        colour = "white" if shares[i, j] < 0.6 else "black"
        table.text(j, i, f"{shares[i, j]:.0%}", ha="center", va="center", fontsize=8, color=colour)
    table.set_xticks(range(n), found.muscles, rotation=30, fontsize=8)
    table.set_yticks(range(n), found.muscles, fontsize=8)
    table.set_title("share of the MVC that each gives (column)\nwhile one contracts (row)", fontsize=9)
    figure.colorbar(shown, ax=table, shrink=0.6)
    figure.suptitle(lines(result)[0], fontsize=9)
    save(figure, png)
