"""A picture of a recording: commands asked, applied, sent and measured, the profile's plots, states, loop timing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Kind
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.plots import MEASURED, TRUTH, Plot, command_plots, indices, profile_plots, split
from srl.runtime.recording.reader import Recording

# Okabe and Ito's colours, which everyone can tell apart. Yellow is left out, as it is faint on white.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#7A5195", "#444444")
# For a command: asked is wide at the bottom, applied and sent lie on it, measured is thin on top. Where they agree,
# all four can be seen.
COMMAND_STYLES: dict[str, dict[str, Any]] = {
    "asked": {"color": "#c4c4c4", "linewidth": 3.5},
    "applied": {"color": "#0072B2", "linewidth": 2.0},
    "sent": {"color": "#009E73", "linewidth": 1.2, "linestyle": (0, (3, 2))},
    MEASURED: {"color": "#D55E00", "linewidth": 0.9},
    TRUTH: {"color": "#D55E00", "linewidth": 0.9, "linestyle": (0, (1, 1))},
}
STATE_COLORS = {
    State.STARTING: "#dddddd",
    State.READY: "#d6eaf8",
    State.ACTIVE: "#cdeadd",
    State.STOPPING: "#fde3b0",
    State.STOPPED: "#f5c6b8",
    State.ENDED: "#bbbbbb",
}
OTHER_STATE = "#e3dff0"
NO_FAULT = (Cause.NONE, Cause.REQUEST, Cause.END)
MOST_POINTS = 4000  # points of a curve; more can't be seen
MOST_CURVES = 8  # curves in one panel without crowded labels
Times = NDArray[np.float64]
Panel = tuple[float, Callable[[Any, Recording, Times], None]]  # height in inches, and the function that draws it


def draw(recording: Recording, png: Path) -> None:
    """Draws the recording to `png`. The panels come from the layout and the profile's `record.plots`.

    Raises:
        RecordingError: a plot names a signal that the recording doesn't have, or the file can't be written.
    """
    now = recording.int("now")
    t = (now - now[0]) / 1e9
    panels: list[Panel] = [(0.4, _states)]
    panels += [(1.25, _drawn(plot, command=True)) for plot in command_plots(recording.layout)]
    panels += [(1.9, _drawn(plot, command=False)) for plot in profile_plots(recording.layout)]
    panels += [(1.5, _timing)] + ([(1.2, _ages)] if recording.layout.devices else [])
    heights = [height for height, _ in panels]
    figure, axes = plt.subplots(
        len(panels), 1, sharex=True, figsize=(11, sum(heights) + 1.0), height_ratios=heights, layout="constrained"
    )
    figure.get_layout_engine().set(h_pad=0.05)
    try:
        for axis, (_, paint) in zip(axes, panels, strict=True):
            paint(axis, recording, t)
        for axis in axes[1:]:
            _bands(axis, recording, t)
            axis.grid(color="#dddddd", linewidth=0.5)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
            axis.tick_params(labelsize=8)
        figure.align_ylabels(axes[1:])
        axes[-1].set_xlabel("time (s)", fontsize=9)
        axes[-1].set_xlim(float(t[0]), float(max(t[-1], t[0] + 1e-6)))
        figure.suptitle(_title(recording, t), fontsize=11)
        figure.savefig(png, dpi=130)
    except OSError as error:
        raise RecordingError(
            str(png), f"the picture can't be written: {error.strerror}", "Choose another place"
        ) from None
    finally:
        plt.close(figure)


def _title(recording: Recording, t: Times) -> str:
    meta = recording.layout.meta
    gone = sum(last - first + 1 for first, last in recording.missing)
    simulated = recording.layout.simulated
    everything = simulated == recording.layout.devices
    parts = [f"{meta.get('name', recording.path.name)}: {len(t)} cycles in {t[-1] - t[0]:.1f} s"]
    parts += ["simulated" if everything else f"simulated: {', '.join(simulated)}"] if simulated else []
    parts += [f"{overruns} overruns"] if (overruns := int(recording.int("overruns").max())) else []
    parts += [f"{gone} rows missing"] if gone else []
    return ", ".join(parts)


def _thin(t: Times, values: NDArray[np.float64]) -> tuple[Times, NDArray[np.float64]]:
    """Reduces a curve to at most MOST_POINTS points: least and largest of each stretch, so that no peak is lost."""
    stretch = -(-len(t) // (MOST_POINTS // 2))
    if stretch < 2:
        return t, values
    starts = np.arange(0, len(t), stretch)
    ends = [np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)]
    return np.repeat(t[starts], 2), np.stack(ends, axis=1).ravel()


def _runs(values: NDArray[np.int64], t: Times) -> list[tuple[int, float, float]]:
    """(index of the first, from, to) of each stretch of equal values."""
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    ends = np.append(starts[1:], len(values) - 1)
    return [(int(a), float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True)]


def _name(number: int, names: Any) -> str:
    return next((n.name.lower().replace("_", " ") for n in names if n == number), str(number))


def _color(state: int) -> str:
    return next((c for s, c in STATE_COLORS.items() if s == state), OTHER_STATE)


def _bands(axis: Any, recording: Recording, t: Times) -> None:
    states = recording.int("state")
    for first, start, end in _runs(states, t):
        if states[first] != State.ACTIVE:
            axis.axvspan(start, end, color=_color(states[first]), alpha=0.5, linewidth=0, zorder=0)


def _states(axis: Any, recording: Recording, t: Times) -> None:
    """Draws the states as a bar, with the cause at each stop's beginning. Faults are red and name their source."""
    states, causes, sources = (recording.int(word) for word in ("state", "cause", "fault_source"))
    span = max(float(t[-1] - t[0]), 1e-6)
    for first, start, end in _runs(states, t):
        axis.axvspan(start, end, color=_color(states[first]), linewidth=0)
        axis.axvline(start, color="#888888", linewidth=0.6)
        if (end - start) / span > 0.06:
            axis.text((start + end) / 2, 0.5, _name(states[first], State), ha="center", va="center", fontsize=8)
    for first, start, _ in _runs(causes, t):
        cause = next((c for c in Cause if c == causes[first]), None)
        if cause is Cause.NONE:
            continue
        text = _name(causes[first], Cause)
        if cause is not None and cause not in NO_FAULT:
            text = f"{text} {recording.layout.fault_source(cause, int(sources[first]))}".rstrip()
        late = start > t[0] + 0.7 * span
        color = "#333333" if cause in NO_FAULT else "#a02000"
        axis.annotate(
            text, (start, 1.0), (-4 if late else 4, 8), textcoords="offset points", fontsize=8, color=color,
            ha="right" if late else "left", va="center", annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
    axis.set_yticks([])
    axis.set_ylim(0, 1)
    axis.tick_params(bottom=False)
    axis.set_ylabel("state", rotation=0, ha="right", va="center", fontsize=9)


def _drawn(plot: Plot, command: bool) -> Callable[[Any, Recording, Times], None]:
    def paint(axis: Any, recording: Recording, t: Times) -> None:
        curves = plot.curves(recording.layout, recording.rows)
        for i, (label, values) in enumerate(curves.items()):
            plain = {"color": COLORS[i % len(COLORS)], "linewidth": 1.2}
            plain["linestyle"] = ("-", "--", ":")[i // len(COLORS) % 3]
            axis.plot(*_thin(t, values), label=label, **(COMMAND_STYLES[label] if command else plain))
        if command:
            _limits(axis, recording, plot)
            axis.margins(y=0.12)
        _finish(axis, plot.title, plot.unit, len(curves))

    return paint


def _limits(axis: Any, recording: Recording, plot: Plot) -> None:
    """Draws the guard's limits of what the axis shows, if the curves come near them.

    A position is between `lower` and `upper`; a velocity and a torque have the same limit in both directions.
    """
    low, high = axis.get_ylim()
    asked = plot.lines["asked"]
    field = recording.layout.fields[split(asked)[0]]
    index = indices(field, asked, asked)
    limits = (recording.layout.meta.get("limits") or {}).get(field.name) or {}
    shown = {
        Kind.POSITION: ((1.0, "lower"), (1.0, "upper")),
        Kind.VELOCITY: ((-1.0, "velocity"), (1.0, "velocity")),
        Kind.TORQUE: ((-1.0, "effort"), (1.0, "effort")),
        Kind.INTENSITY: ((1.0, "level"),),
    }
    for sign, key in shown[_kind(recording.layout, field)]:
        if limits.get(key) is None:
            continue
        limit = sign * np.reshape(limits[key], field.shape)[index]
        if low <= limit <= high:
            axis.axhline(limit, color="#a02000", linewidth=0.8, linestyle=(0, (6, 4)), label="limit", zorder=1)


def _kind(layout: Layout, command: Field) -> Kind:
    """What a command commands. A recording of an earlier version doesn't say so; there the unit tells."""
    command_meta = (layout.meta.get("commands") or {}).get(command.name)
    if command_meta is not None:
        return Kind(command_meta["kind"])
    if "/s" in command.unit:
        return Kind.VELOCITY
    return Kind.TORQUE if "N" in command.unit else Kind.POSITION


def _finish(axis: Any, title: str, unit: str, curves: int) -> None:
    axis.set_title(title, loc="left", fontsize=9, pad=3)
    axis.set_ylabel(unit, fontsize=9)
    if curves <= 3 * MOST_CURVES:
        handles, labels = axis.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        columns = -(-len(once) // MOST_CURVES)
        axis.legend(
            once.values(), once.keys(), fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.05),
            ncols=columns, labelspacing=0.25,
        )  # fmt: skip


def _timing(axis: Any, recording: Recording, t: Times) -> None:
    """Draws the period (wake to wake) and the cycle time (wake to the end of writing), ms."""
    wake, write = recording.int("wake"), recording.int("write")
    for name, values, at, color in (
        ("period", np.diff(wake) / 1e6, t[1:], COLORS[0]),
        ("cycle", (write - wake) / 1e6, t, COLORS[1]),
    ):
        if len(values):
            p50, p99 = np.percentile(values, [50, 99])
            label = f"{name}\n p50 {p50:.3g}, p99 {p99:.3g}\n max {values.max():.3g}"
            axis.plot(*_thin(at, values), color=color, linewidth=0.8, label=label)
    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.yaxis.set_minor_locator(NullLocator())
    _finish(axis, "Loop timing: from wake to wake, and from wake to the last write", "ms", 2)


def _ages(axis: Any, recording: Recording, t: Times) -> None:
    """Draws the age of each device's newest sample when the cycle began, ms; nothing before the first sample."""
    now = recording.int("now")
    for i, device in enumerate(recording.layout.devices):
        stamp = recording.int(f"{device}.stamp")
        ages = np.where(stamp < 0, np.nan, (now - stamp) / 1e6)
        axis.plot(*_thin(t, ages), color=COLORS[i % len(COLORS)], linewidth=0.8, label=device)
    axis.set_ylim(0, 1.1 * axis.dataLim.ymax if axis.dataLim.ymax > 0 else 1.0)
    _finish(axis, "Age of the devices' samples", "ms", len(recording.layout.devices))
