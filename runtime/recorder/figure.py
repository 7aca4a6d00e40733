"""A picture of a recording: commands asked, applied and measured, distances, states, loop timing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from runtime.errors import RecordingError
from runtime.layout import Cause, State
from runtime.recorder.plots import Plot, series_names
from runtime.recorder.reader import Recording

# Okabe and Ito's colours, told apart by everyone; yellow is left out, as it is faint on white.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#7A5195", "#444444")
STATE_COLORS = {
    State.STARTING: "#dddddd",
    State.READY: "#d6eaf8",
    State.ACTIVE: "#ffffff",
    State.STOPPING: "#fde3b0",
    State.STOPPED: "#f5c6b8",
    State.ENDED: "#bbbbbb",
}
OTHER_STATE = "#e3dff0"
MOST_POINTS = 4000  # a curve's points; more can't be seen
MOST_CURVES = 8  # of one panel without labels crowding it


def draw(recording: Recording, png: Path) -> None:
    """Draws the recording to `png`; panels come from the layout and the profile's `record.plots`.

    Raises:
        RecordingError: a plot names what the recording doesn't have, or the file can't be written.
    """
    layout, rows = recording.layout, recording.rows
    now = recording.int("now")
    t = (now - now[0]) / 1e9
    plots = [Plot(**p) for p in (layout.meta.get("record") or {}).get("plots", ())]
    curves = [plot.curves(layout, rows) for plot in plots]
    commands = [f.name for f in layout.fields.values() if f.role == "command" and f.size]
    heights = [0.6, *[2.4] * (len(commands) + len(plots)), 2.0]
    figure, axes = plt.subplots(
        len(heights),
        1,
        sharex=True,
        figsize=(11, sum(heights) + 1.4),
        height_ratios=heights,
        layout="constrained",
    )
    try:
        _states(axes[0], recording, t)
        for axis, name in zip(axes[1:], commands, strict=False):
            _command(axis, recording, t, name)
        for axis, plot, lines in zip(axes[1 + len(commands) :], plots, curves, strict=False):
            _curves(axis, t, plot.title, plot.unit, lines)
        _timing(axes[-1], recording, t)
        for axis in axes[1:]:
            _bands(axis, recording, t)
            axis.grid(color="#dddddd", linewidth=0.5)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
        axes[-1].set_xlabel("time (s)")
        axes[-1].set_xlim(float(t[0]), float(max(t[-1], t[0] + 1e-6)))
        name = layout.meta.get("name", recording.path.name)
        gone = sum(last - first + 1 for first, last in recording.missing)
        simulated = ", simulated" if layout.meta.get("simulated") else ""
        figure.suptitle(
            f"{name}: {len(t)} cycles in {t[-1]:.1f} s{simulated}"
            + (f", {gone} rows missing" if gone else "")
        )
        figure.savefig(png, dpi=110)
    except OSError as error:
        raise RecordingError(
            str(png), f"the picture can't be written: {error.strerror}", "Choose another place"
        ) from None
    finally:
        plt.close(figure)


def _thin(
    t: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most MOST_POINTS points of a curve: least and largest of each stretch, so that no peak is lost."""
    stretch = -(-len(t) // (MOST_POINTS // 2))
    if stretch < 2:
        return t, values
    starts = np.arange(0, len(t), stretch)
    ends = [np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)]
    return np.repeat(t[starts], 2), np.stack(ends, axis=1).ravel()


def _runs(values: NDArray[np.int64], t: NDArray[np.float64]) -> list[tuple[int, float, float]]:
    """(value, from, to) of each stretch of equal values."""
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    ends = np.append(starts[1:], len(values) - 1)
    return [(int(values[a]), float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True)]


def _name(number: int, names: Any) -> str:
    return next((n.name.lower().replace("_", " ") for n in names if n == number), str(number))


def _bands(axis: Any, recording: Recording, t: NDArray[np.float64]) -> None:
    for state, start, end in _runs(recording.int("state"), t):
        if state != State.ACTIVE:
            color = next((c for s, c in STATE_COLORS.items() if s == state), OTHER_STATE)
            axis.axvspan(start, end, color=color, alpha=0.5, linewidth=0, zorder=0)


def _states(axis: Any, recording: Recording, t: NDArray[np.float64]) -> None:
    """The states as a bar, with the cause under each stop."""
    span = max(float(t[-1] - t[0]), 1e-6)
    for state, start, end in _runs(recording.int("state"), t):
        color = next((c for s, c in STATE_COLORS.items() if s == state), OTHER_STATE)
        axis.axvspan(start, end, color=color, linewidth=0)
        axis.axvline(start, color="#888888", linewidth=0.6)
        if (end - start) / span > 0.06:
            axis.text((start + end) / 2, 0.68, _name(state, State), ha="center", va="center", fontsize=8)
    for cause, start, end in _runs(recording.int("cause"), t):
        if cause != Cause.NONE:
            late = start > t[0] + 0.7 * span
            at, side = (end, "right") if late else (start, "left")
            axis.text(at, 0.25, f" {_name(cause, Cause)} ", ha=side, va="center", fontsize=8, color="#a02000")
    axis.set_yticks([])
    axis.set_ylim(0, 1)
    axis.set_ylabel("state", rotation=0, ha="right", va="center")


def _command(axis: Any, recording: Recording, t: NDArray[np.float64], name: str) -> None:
    """Asked (dotted) and applied (full) for each element."""
    layout = recording.layout
    asked = recording.value(name).reshape(len(t), -1)
    applied = (
        recording.value(f"{name}.applied").reshape(len(t), -1) if f"{name}.applied" in layout.fields else None
    )
    for i, label in enumerate(series_names(layout, name)):
        color = COLORS[i % len(COLORS)]
        if applied is not None:
            axis.plot(*_thin(t, applied[:, i]), color=color, linewidth=1.3, label=label)
        axis.plot(
            *_thin(t, asked[:, i]),
            ":",
            color=color,
            linewidth=1.3,
            label=None if applied is not None else label,
        )
    title = name if applied is None else f"{name}: asked (dotted), applied (full)"
    _finish(axis, title, layout.fields[name].unit, asked.shape[1])


def _curves(
    axis: Any, t: NDArray[np.float64], title: str, unit: str, lines: dict[str, NDArray[np.float64]]
) -> None:
    styles = ("-", "--", ":")
    for i, (label, values) in enumerate(lines.items()):
        style = styles[i // len(COLORS) % len(styles)]
        axis.plot(*_thin(t, values), style, color=COLORS[i % len(COLORS)], linewidth=1.2, label=label)
    _finish(axis, title, unit, len(lines))


def _finish(axis: Any, title: str, unit: str, curves: int) -> None:
    axis.set_title(title, loc="left", fontsize=10)
    axis.set_ylabel(unit)
    if curves <= 3 * MOST_CURVES:
        columns = -(-curves // MOST_CURVES)
        axis.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=columns)


def _timing(axis: Any, recording: Recording, t: NDArray[np.float64]) -> None:
    """Period (wake to wake) and cycle time (wake to the end of writing), us."""
    wake, write = recording.int("wake"), recording.int("write")
    if len(t) > 1:
        axis.plot(*_thin(t[1:], np.diff(wake) / 1e3), color=COLORS[0], linewidth=0.8, label="period")
    axis.plot(*_thin(t, (write - wake) / 1e3), color=COLORS[1], linewidth=0.8, label="cycle")
    axis.set_yscale("log")
    _finish(axis, "Loop timing", "us", 2)
