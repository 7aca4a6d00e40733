"""The report of a suit's calibration: text, figures and a picture."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from srl.commissioning.calibration.picture import save
from srl.commissioning.calibration.suit.fit import PER_MINUTE, Suit
from srl.commissioning.calibration.suit.samples import SuitMarksConfig
from srl.commissioning.calibration.suit.segments import SuitError


@dataclass(frozen=True)
class Result:
    """What was found, and why it can't be used, if it can't.

    Attributes:
        options: with which it was measured.
        simulated: whether the suit was.
        found: what was found.
        date: of the measurement.
        refusals: why it can't be used.
    """

    options: SuitMarksConfig
    simulated: bool
    found: Suit
    date: datetime.date
    refusals: tuple[SuitError, ...]


def lines(result: Result) -> list[str]:
    """The report as text."""
    found, options = result.found, result.options
    times = found.stands.times
    text = [
        f"{options.person}, {options.signal}{' (simulated)' if result.simulated else ''}, {result.date.isoformat()}, "
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


def metrics(result: Result) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    found, options = result.found, result.options
    return {
        "person": options.person, "signal": options.signal, "date": result.date.isoformat(),
        "simulated": result.simulated, "pose": options.plan.pose, "heading": found.heading, "uncertain": found.scatter,
        "seconds": float(found.stands.times[-1] - found.stands.times[0]), "whole": found.whole,
        "segments": {
            name: {
                "rate": float(found.rates[i]), "uncertain": float(found.uncertain[i]),
                "tilt": float(found.tilts[:, i].max()), "measured": bool(found.measured[i]),
            }
            for i, name in enumerate(found.segments)
        },
        "refusals": [{"place": r.place, "problem": r.problem} for r in result.refusals],
    }  # fmt: skip


def draw(result: Result, png: Path) -> None:
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
