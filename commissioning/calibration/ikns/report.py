"""How good a calibration is: as figures, as text, and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from srl.commissioning.calibration.ikns.result import Result
from srl.commissioning.calibration.picture import plt, save
from srl.runtime.contracts.signals import Array

_COLORS = ("#0072B2", "#E69F00", "#009E73")  # Okabe and Ito's, one a DoF


def metrics(result: Result) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    found = result.found
    points = [
        {
            "number": number,
            "site": _list(found.sites[i]),
            "wander": _number(found.wander[i]),
            "agreement": _number(found.agreement[i]),
            "dofs": {
                dof: {
                    "samples": int(found.samples[i, j]),
                    "range": _number(found.upper[i, j] - found.lower[i, j]),
                    "explained": _number(found.explained[i, j]),
                    "noise_per_mm": None if result.noise is None else _number(result.noise[i, j]),
                }
                for j, dof in enumerate(result.dofs)
            },
        }
        for i, number in enumerate(result.numbers)
    ]
    return {
        "frame": result.channel_map.frame,
        "joints": list(result.channel_map.joints),
        "dofs": list(result.dofs),
        "still": found.still,
        "lost": found.lost,
        "noise_per_mm": _noise(result),
        "crosstalk": crosstalk(result),
        "direction": {
            "file": None if result.direction is None else str(result.direction),
            "turned": list(result.turned),
        },
        "points": points,
        "refusals": [{"place": r.place, "problem": r.problem, "remedy": r.remedy} for r in result.refusals],
    }


def crosstalk(result: Result) -> float | None:
    """The greatest share of its range that a DoF moves when another one goes through its own; None for one DoF."""
    k = len(result.dofs)
    away = np.abs(result.found.crosstalk[:, ~np.eye(k, dtype=bool)])
    return _number(np.nanmax(away)) if k > 1 and np.isfinite(away).any() else None


def lines(result: Result) -> list[str]:
    """The report as text."""
    found, reported = result.found, metrics(result)
    text = [
        f"person {result.person}{result.when}: {len(result.numbers)} points, {', '.join(result.dofs)}; "
        f"{found.still:.0%} of the samples with the hand still, {found.lost:.1%} without angles or hand"
    ]
    text.append("  point  degree of freedom  kept  range rad  explained  noise of c per mm  hand mm rms")
    for i, number in enumerate(result.numbers):
        for j, dof in enumerate(result.dofs):
            noise = "-" if result.noise is None else f"{result.noise[i, j]:.4f}"
            text.append(
                f"  {number:5d}  {dof:<17}  {found.samples[i, j]:4d}  {found.upper[i, j] - found.lower[i, j]:9.2f}"
                f"  {found.explained[i, j]:9.0%}  {noise:>17}  {1e3 * found.wander[i]:11.1f}"
            )
    if reported["noise_per_mm"]:
        each = ", ".join(f"{dof} {value:.4f}" for dof, value in reported["noise_per_mm"].items())
        text.append(f"  expected noise of c per mm of marker noise, mean of the points: {each}")
    if result.direction is not None:
        turned = f": {', '.join(result.turned)} turned round for it" if result.turned else ""
        text.append(f"  the direction is that of {result.direction}{turned}")
    if reported["crosstalk"] is not None:
        share = f"{reported['crosstalk']:.3f}"
        text.append(f"  while one DoF moves, another goes through {share} of its range at most (in these samples)")
    return text


def draw(result: Result, png: Path) -> None:
    """Draws the report. Raises RecordError: it can't be written."""
    found = result.found
    figure = plt.figure(figsize=(11, 7.5), constrained_layout=True)
    wide = 0.8 / len(result.dofs)
    at = np.arange(len(result.numbers))
    panels: list[tuple[str, Array, float | None]] = [
        ("range, rad", found.upper - found.lower, result.options.thresholds.range),
        ("variance explained", found.explained, result.options.thresholds.least_explained),
        ("samples kept", found.samples.astype(float), float(result.options.thresholds.samples)),
    ]
    if result.noise is not None:
        panels.append(("expected noise of c per mm of marker noise", result.noise, None))
    grid = figure.add_gridspec(len(panels), 2, width_ratios=(1.25, 1.0))
    _space(figure.add_subplot(grid[:, 0], projection="3d"), result)
    for row, (title, values, least) in enumerate(panels):
        axes = figure.add_subplot(grid[row, 1])
        for j, dof in enumerate(result.dofs):
            axes.bar(at + (j - (len(result.dofs) - 1) / 2) * wide, values[:, j], wide, color=_COLORS[j % 3], label=dof)
        if least is not None:
            axes.axhline(least, color="#444444", linewidth=0.8, linestyle="--")
        axes.set_title(title, fontsize=9, loc="left")
        axes.set_xticks(at, [str(n) for n in result.numbers])
        axes.tick_params(labelsize=8)
    figure.axes[-1].set_xlabel("point", fontsize=8)
    figure.axes[1].legend(fontsize=8, loc="lower right")
    reported = crosstalk(result)
    talk = "" if reported is None else f", crosstalk up to {reported:.3f} (in sample)"
    figure.suptitle(f"IKNS calibration of {result.person}{result.when}{talk}", fontsize=11)
    save(figure, png)


def _space(axes: Any, result: Result) -> None:
    """Samples, points with their numbers, and the points' hull, in the hand's frame."""
    found, hand = result.found, result.recording.hand
    seen = hand[np.isfinite(hand).all(axis=1)]
    some = seen[:: max(len(seen) // 3000, 1)]
    axes.scatter(*some.T, s=1, color="#bbbbbb", depthshade=False)
    axes.scatter(*found.sites.T, s=25, color="#D55E00", depthshade=False)
    for number, site in zip(result.numbers, found.sites, strict=True):
        axes.text(*site, f" {number}", fontsize=9)
    try:
        for triangle in ConvexHull(found.sites).simplices:
            around = found.sites[[*triangle, triangle[0]]]
            axes.plot(*around.T, color="#0072B2", linewidth=0.7, alpha=0.6)
    except (QhullError, ValueError):
        pass  # flat: the refusals say so
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_zlabel("z, m")
    axes.tick_params(labelsize=7)
    axes.set_aspect("equal")
    axes.set_title(f"hand in {result.channel_map.frame}: samples of the trials, points and hull", fontsize=9)


def _noise(result: Result) -> dict[str, float | None] | None:
    if result.noise is None:
        return None
    return {dof: _number(np.nanmean(result.noise[:, j])) for j, dof in enumerate(result.dofs)}


def _list(values: Array) -> list[float | None]:
    return [_number(value) for value in values]


def _number(value: Any) -> float | None:
    """JSON has no infinity."""
    return float(value) if np.isfinite(value) else None
