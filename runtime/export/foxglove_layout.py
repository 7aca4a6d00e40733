"""A layout for Foxglove's app: the limb in 3D, what each command did and was measured, the state, and the events.

It names the topics of `srl.runtime.ros2.topics`, which a recording in MCAP and a live run have alike. The file is in
the form that the app's "Import from file" takes since Foxglove Studio 1: panels by id, and how they are arranged.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.field import Field
from srl.runtime.export.report import whole_file
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages.messages import JOINT_STATE, MULTI_ARRAY, POSE, TWIST, WRENCH, kind_of, message_of
from srl.runtime.profile.plots import MEASURED, TRUTH, Plot, command_plots, pick, profile_plots, split
from srl.runtime.recording.robots import robots
from srl.runtime.recording.shapes import PALETTE, visuals
from srl.runtime.ros2.topics import Topics, topic_of

NEAR: Final = 0.5  # m, of the camera from a finger
FAR: Final = 4.0  # m, from a person
FRONT: Final = -65  # degrees: from the root's x, a little from the right
LISTED: Final = 6  # curves that a legend names: it would cover a plot with more
SHOWN: Final = (MEASURED, TRUTH, "sent")  # of a command
PAIR: Final = 2  # lines of an element: where it is, and what was sent
# By type of message: the path of each of its numbers, in the signal's order.
_PATHS: Final = {
    WRENCH: [f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"],
    TWIST: [f"twist.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"],
    POSE: [*(f"pose.position.{axis}" for axis in "xyz"), *(f"pose.orientation.{axis}" for axis in "wxyz")],
}
_STATES: Final = {"active": (0, 158, 115), "stopping": (230, 159, 0), "stopped": (213, 94, 0)}
_OTHER: Final = (90, 90, 90)

Panel = dict[str, Any]


def write(layout: Layout, target: Path) -> int:
    """Writes the layout for runs with these rows, and returns the number of panels.

    Raises:
        RecordingError: it can't be written.
    """
    made = layout_of(layout)
    with whole_file(target) as part:
        part.write_text(json.dumps(made, indent=1) + "\n")
    return len(made["configById"])


def layout_of(layout: Layout) -> dict[str, Any]:
    """The layout for runs with these rows, as JSON has it."""
    topics = Topics(layout, 0)
    names = {topic.name for topic in topics.all}
    panels: dict[str, Panel] = {"3D!scene": _scene(layout, topics.tree.root, names)}
    plots = [*_command_panels(layout), *_profile_panels(layout)]
    for number, panel in enumerate(plots):
        panels[f"Plot!{number}"] = panel
    panels["StateTransitions!state"] = {
        "foxglovePanelTitle": "State and cause", "isSynced": True,
        "paths": [_states("state", State), _states("cause", Cause)],
    }  # fmt: skip
    panels["RosOut!events"] = {
        "foxglovePanelTitle": "Events", "minLogLevel": 1, "searchTerms": [], "topicToRender": "/rosout",
    }  # fmt: skip
    right: Any = _row("column", "StateTransitions!state", "RosOut!events", 50)
    if plots:
        tabs = [{"title": panel["foxglovePanelTitle"], "layout": f"Plot!{i}"} for i, panel in enumerate(plots)]
        panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": tabs}
        right = _row("column", "Tab!plots", right, 60)
    return {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
        "layout": _row("row", "3D!scene", right, 55),
    }  # fmt: skip


def _row(direction: str, first: Any, second: Any, percentage: int) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}


def _scene(layout: Layout, root: str, names: set[str]) -> Panel:
    """The 3D panel; it stands in the root frame."""
    people = any(f.visual in ("skeleton", "robot", "capsules") or f.size > 100 for f in visuals(layout))
    reach = max((_reach(robot.linkage.links) for robot in robots(layout)), default=0.0)
    distance = FAR if people else max(NEAR, 3 * reach)
    shown = [name for name in ("/scene", "/scenery", "/robot_description") if name in names]
    return {
        "foxglovePanelTitle": "Limb", "followTf": root, "fixedFrame": root, "followMode": "follow-pose",
        "cameraState": {
            "distance": distance, "perspective": True, "phi": 70, "thetaOffset": FRONT,
            "targetOffset": [0, 0, 1.0 if people and reach < FAR else 0], "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1], "fovy": 45, "near": 0.01, "far": 500,
        },
        "scene": {"enableStats": False, "transforms": {"showLabel": False, "axisScale": 0.1 * distance}},
        "topics": {name: {"visible": True} for name in shown},
        "layers": {"grid": {
            "layerId": "foxglove.Grid", "instanceId": "grid", "label": "Grid", "visible": True, "frameLocked": True,
            "frameId": root, "size": distance, "divisions": 10, "lineWidth": 1, "color": "#55555588",
            "position": [0, 0, 0], "rotation": [0, 0, 0],
        }},
    }  # fmt: skip


def _reach(links: Sequence[Any]) -> float:
    """m, of a limb that is stretched out."""
    return float(sum(np.linalg.norm(link.pose[:3]) for link in links))


def _command_panels(layout: Layout) -> list[Panel]:
    """A plot for each command: every element as it was measured and sent."""
    found: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for plot in command_plots(layout):
        command = split(plot.lines["asked"])[0]
        stem = command.removesuffix("_command")
        units[stem] = plot.unit if units.setdefault(stem, plot.unit) == plot.unit else "mixed units"
        element = plot.title.removeprefix(stem).strip()
        lines = found.setdefault(stem, {})
        for what in SHOWN:
            if what in plot.lines:
                lines |= _series(layout, f"{element} {what}".strip(), plot.lines[what])
    return [_plot(stem, units[stem], lines) for stem, lines in found.items()]


def _profile_panels(layout: Layout) -> list[Panel]:
    """The profile's plots, but for distances: the app has no path for one."""
    return [_plot(plot.title, plot.unit, lines) for plot in profile_plots(layout) if (lines := _lines(layout, plot))]


def _lines(layout: Layout, plot: Plot) -> dict[str, str]:
    found: dict[str, str] = {}
    for label, reference in plot.lines.items():
        found |= _series(layout, label, reference)
    return found


def _plot(title: str, unit: str, lines: Mapping[str, str]) -> Panel:
    paths = [
        {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime"}
        | ({"color": _color(PALETTE[i // PAIR % len(PALETTE)])} if label.split()[-1] in SHOWN else {})
        | ({"lineSize": 3.0} if label.endswith("sent") else {})
        for i, (label, path) in enumerate(lines.items())
    ]
    return {
        "foxglovePanelTitle": f"{title}, {unit}", "paths": paths, "isSynced": True, "xAxisVal": "timestamp",
        "showXAxisLabels": True, "showYAxisLabels": True, "showLegend": len(paths) <= LISTED,
        "legendDisplay": "floating", "showPlotValuesInLegend": False, "sidebarDimension": 240, "followingViewWidth": 20,
    }  # fmt: skip


def _series(layout: Layout, label: str, reference: str) -> dict[str, str]:
    """The paths of a reference, by label; a larger signal has one for each of its numbers."""
    field = layout.fields[split(reference)[0]]
    row = np.zeros((1, layout.width), np.int64)  # whose numbers are their own places in the signal
    place = slice(layout.ints + field.offset, layout.ints + field.offset + field.size)
    row[0, place] = np.arange(field.size, dtype=np.float64).view(np.int64)
    places = np.atleast_1d(pick(layout, row, reference, "a plot")[0]).ravel().astype(int).tolist()
    names = [label] if len(places) == 1 else [f"{label} {i}" for i in range(len(places))]
    return {name: value_path(field, at) for name, at in zip(names, places, strict=True)}


def value_path(field: Field, place: int) -> str:
    """The app's path to a number of a signal: "/finger/position.position[2]"."""
    kind = kind_of(field)
    if kind == JOINT_STATE:
        message = message_of(field, np.zeros(field.shape), 0)[1]
        name = next(name for name in ("position", "velocity", "effort") if len(message[name]))
        inner = f"{name}[{place}]"
    else:
        inner = f"data[{place}]" if kind == MULTI_ARRAY else _PATHS[kind][place]
    return f"{topic_of(field)}.{inner}"


def _states(word: str, names: Iterable[Any]) -> dict[str, Any]:
    """A word of the cycle as states in time, with their names."""
    called = {str(int(n)): n.name.lower() for n in names}
    states = [
        {"value": value, "label": name.replace("_", " "), "color": _color(_STATES.get(name, _OTHER))}
        for value, name in called.items()
    ]
    return {
        "value": f"/loop/cycle.data[{CYCLE._fields.index(word)}]", "label": word, "timestampMethod": "receiveTime",
        "enabled": True, "customStates": {"type": "discrete", "states": states},
    }  # fmt: skip


def _color(rgb: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)
