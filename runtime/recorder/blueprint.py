"""The viewer's arrangement, made from a layout: 3D, an overview, commands, plots, timing, states and events."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.pictures.camera import look
from srl.runtime.profile.plots import Plot, command_plots, joint_plots, profile_plots
from srl.runtime.recorder.scene import plot_path
from srl.runtime.recording.columns import entity
from srl.runtime.recording.format import EVENTS
from srl.runtime.recording.robots import FixedRobots
from srl.runtime.recording.shapes import visuals

NAMED, FEW = 5, 3  # curves in one view that its legend names, and in a low one
STACKED = 5  # views of curves in one column; more go side by side


def make(layout: Layout, row: Words | None) -> rrb.Blueprint:
    """The blueprint of a layout.

    `row` (width,), if there is one, decides where the 3D view looks at first.
    """
    loop = [
        _period(),
        _series("Phases of the cycle (us, largest of each 1/30 s)", "/loop/timing/phases"),
        _series("Age of the devices' samples (ms)", "/loop/timing/ages"),
    ]
    plots, joints = profile_plots(layout), joint_plots(layout)
    shown = plots[: STACKED - 1 - min(len(joints), 2)]
    chosen = [*shown, *joints[: STACKED - 1 - len(shown)]]
    overview = [_plot(p, layout, NAMED if len(chosen) < 3 else FEW) for p in chosen]
    groups = {
        "Overview": [*overview, _period()] if overview else [],
        "Commands": [_plot(p, layout) for p in command_plots(layout)],
        "Plots": [_plot(p, layout) for p in plots],
        "Loop": loop,
    }
    tabs = [_stack(name, views) for name, views in groups.items() if views]
    tabs.append(rrb.TextDocumentView(name="Profile", contents=["/profile"]))
    events = rrb.TextLogView(
        name="Events",
        contents=[EVENTS],
        columns=rrb.TextLogColumns(timeline_columns=["time"], text_log_columns=["LogLevel", "Body"]),
    )
    left = [events]
    standing = FixedRobots(layout)
    shapes, drawn = visuals(layout), standing.robots
    if shapes or drawn:
        # Where a robot is drawn whole, the simulated world's lines of it would only hide it.
        seen = [entity(f.name) for f in shapes if f.name not in standing.hidden]
        view = rrb.Spatial3DView(
            name="3D",
            contents=[
                *seen,
                *(f"/{robot.entity}/**" for robot in drawn),
                "/scenery/**",
                "/tf",
                "/frames/**",
                "/axes/**",
            ],
            eye_controls=None if row is None else look(layout, row, shapes),
        )
        left = [view, events]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Vertical(*left, row_shares=[3, 1][: len(left)]),
                rrb.Tabs(*tabs, active_tab=0),
                column_shares=[1, 1],
            ),
            rrb.StateTimelineView(name="State and cause", contents=["/loop/state", "/loop/cause"]),
            row_shares=[5, 1],
        ),
        rrb.TimePanel(timeline="time", state="collapsed", play_state="playing"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def _plot(plot: Plot, layout: Layout, named: int = NAMED) -> rrb.TimeSeriesView:
    # A legend of more lines covers the curves; the pointer names each curve all the same.
    curves = plot.curves(layout, np.zeros((1, layout.width), np.int64))
    return _series(f"{plot.title} ({plot.unit})", plot_path(plot), legend=1 < len(curves) <= named)


def _period() -> rrb.TimeSeriesView:
    """A view of its own each time: the viewer refuses one that is in two places."""
    return _series("Period and cycle (ms, largest of each 1/30 s)", "/loop/timing/period", "/loop/timing/cycle")


def _series(name: str, *paths: str, legend: bool = True) -> rrb.TimeSeriesView:
    place = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend)
    return rrb.TimeSeriesView(name=name, contents=list(paths), plot_legend=place)


def _stack(name: str, views: list[rrb.TimeSeriesView]) -> rrb.Container:
    if len(views) <= STACKED:
        return rrb.Vertical(*views, name=name)
    return rrb.Grid(*views, name=name, grid_columns=2 if len(views) <= 2 * STACKED else 3)
