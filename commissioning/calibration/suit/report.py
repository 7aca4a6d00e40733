"""The report of a suit's calibration: text, figures and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.suit.fit import PER_MINUTE, Suit


def lines(result: Result[Suit]) -> list[str]:
    """The report as text."""
    found, options = result.found, result.options
    times = found.stands.times
    text = [
        f"{options.person}, {options.signal}{result.when}, "
        f"{len(times)} stands in {(times[-1] - times[0]) / 60.0:.1f} min",
        f"heading at the end: {np.degrees(found.heading):.1f} degrees to the left (standard deviation "
        f"{np.degrees(found.scatter):.1f}), plus the error of how the person stood",
        "segment          drift deg/min  uncertain  greatest tilt degrees",
    ]
    for i, name in enumerate(found.segments):
        own = "" if found.measured[i] else "  no sensor of its own"
        text.append(
            f"{name:<16} {PER_MINUTE * found.rates[i]:+13.2f}  {PER_MINUTE * found.uncertain[i]:9.2f}  "
            f"{np.degrees(found.tilts[:, i].max()):21.1f}{own}"
        )
    text.append(
        f"hips and chest together: {PER_MINUTE * found.whole:+.2f} deg/min: the suit's drift, or how the person "
        "stood, which can't be told apart"
    )
    text.append("the heading is corrected, drift is not: it needn't go on like this")
    return text


def metrics(result: Result[Suit]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    found, options = result.found, result.options
    return {
        "signal": options.signal, "pose": options.plan.pose, "heading": found.heading, "uncertain": found.scatter,
        "seconds": float(found.stands.times[-1] - found.stands.times[0]), "whole": found.whole,
        "segments": {
            name: {
                "rate": float(found.rates[i]), "uncertain": float(found.uncertain[i]),
                "tilt": float(found.tilts[:, i].max()), "measured": bool(found.measured[i]),
            }
            for i, name in enumerate(found.segments)
        },
    }  # fmt: skip


def draw(result: Result[Suit], png: Path) -> None:
    """Draws each segment's heading in the stands, and its drift. Raises RecordError."""
    found, limits = result.found, result.options.thresholds
    n = len(found.segments)
    figure, (course, drift) = plt.subplots(1, 2, figsize=(13, 1.5 + 0.28 * n), constrained_layout=True)
    minutes = (found.stands.times - found.stands.times[0]) / 60.0
    colours = plt.get_cmap("turbo")(np.linspace(0.0, 1.0, n))
    for i, name in enumerate(found.segments):
        course.plot(minutes, np.degrees(found.headings[:, i]), "o-", color=colours[i], markersize=3, label=name)
    course.set_xlabel("min")
    course.set_ylabel("heading since the first stand, degrees")
    course.legend(fontsize=6, ncols=2)
    rows = np.arange(n)
    rates, sure = PER_MINUTE * found.rates, PER_MINUTE * found.uncertain
    over = (np.abs(rates) > limits.drift) & found.measured
    drift.barh(rows, rates, xerr=2.0 * sure, color=np.where(over, "#D55E00", "#0072B2"))
    for edge in (-limits.drift, limits.drift):
        drift.axvline(edge, color="#D55E00", linestyle="--")
    drift.set_yticks(rows, found.segments, fontsize=8)
    drift.invert_yaxis()
    drift.set_xlabel("drift, deg/min, with two standard deviations; dashed: what is allowed")
    figure.suptitle(lines(result)[0], fontsize=9)
    save(figure, png)
