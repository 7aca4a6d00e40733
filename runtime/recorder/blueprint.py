"""The viewer's arrangement, made from a layout: 3D, commands, the profile's plots, timing, states, notes."""

from __future__ import annotations

import rerun.blueprint as rrb

from runtime.layout import Layout
from runtime.recorder.columns import entity
from runtime.recorder.scene import plot_path, plots, visuals


def make(layout: Layout) -> rrb.Blueprint:
    """The blueprint of a layout."""
    commands = [
        rrb.TimeSeriesView(
            name=f"{f.name} ({f.unit})",
            contents=[entity(f.name)]
            + ([entity(f"{f.name}.applied")] if f"{f.name}.applied" in layout.fields else []),
        )
        for f in layout.fields.values()
        if f.role == "command"
    ]
    asked = [rrb.TimeSeriesView(name=f"{p.title} ({p.unit})", contents=[plot_path(p)]) for p in plots(layout)]
    timing = [
        rrb.TimeSeriesView(
            name="Period and cycle (us, largest of each 1/30 s)", contents=_timing("period", "cycle")
        ),
        rrb.TimeSeriesView(name="Phases of the cycle (us)", contents=_timing("phases")),
        rrb.TimeSeriesView(name="Age of the devices' samples (ms)", contents=_timing("ages")),
    ]
    tabs = [
        rrb.Vertical(*views, name=name) for name, views in (("Plots", asked), ("Commands", commands)) if views
    ]
    tabs.append(rrb.Vertical(*timing, name="Loop"))
    tabs.append(rrb.TextDocumentView(name="Profile", contents=["/profile"]))
    shapes = [entity(f.name) for f in visuals(layout)]
    notes = rrb.TextLogView(name="Notes", contents=["/notes"])
    left = [rrb.Spatial3DView(name="3D", contents=[*shapes, "/frames/**"]), notes] if shapes else [notes]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Vertical(*left, row_shares=[3, 1][: len(left)]), rrb.Tabs(*tabs), column_shares=[1, 1]
            ),
            rrb.StateTimelineView(name="State and cause", contents=["/loop/state", "/loop/cause"]),
            row_shares=[5, 1],
        ),
        rrb.TimePanel(timeline="time", state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def _timing(*names: str) -> list[str]:
    return [f"/loop/timing/{name}" for name in names]
