"""A layout names what the MCAP of the same profile has; its panels' settings are those that Foxglove's types know."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.run import refused

from srl.runtime.cli import main
from srl.runtime.export import formats
from srl.runtime.export.foxglove_layout import layout_of, value_path
from srl.runtime.ipc.header import State
from srl.runtime.ipc.layout import Layout
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.reader import Recording

PROFILES = sorted(path.stem for path in (ROOT / "profiles").glob("*.yaml"))


def paths(layout: dict[str, Any]) -> list[str]:
    """All message paths in the panels."""
    return [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())]


def at(message: Any, inner: str) -> float:
    """The number at a message path: names, and indices of arrays."""
    for name, index in re.findall(r"\.(\w+)(?:\[(\d+)\])?", f".{inner}"):
        message = getattr(message, name)
        message = message[int(index)] if index else message
    return float(message)


def first_messages(name: str, folder: Path, numbered: bool = False) -> tuple[Recording, dict[str, list[Any]]]:
    """A profile's first cycles, all devices simulated, and its MCAP by topic as rosbags reads it.

    `numbered`: the last row's signals are made to be 0, 1, 2, ...
    """
    from rosbags.highlevel import AnyReader

    graph = wiring.build(*profile.load(name), [])
    step, rows = Lockstep(graph), []
    for _ in range(30):
        step.step()
        rows.append(graph.row.words.copy())
    if numbered:
        rows[-1][graph.layout.ints :] = np.arange(len(rows[-1]) - graph.layout.ints, dtype=np.float64).view(np.int64)
    recording = Recording(folder / "made-up.rrd", graph.layout, np.arange(30), np.array(rows), [], [], 0)
    formats.write("mcap", recording, folder / "run.mcap")
    found: dict[str, list[Any]] = {}
    with AnyReader([folder / "run.mcap"]) as reader:
        found = {connection.topic: [] for connection in reader.connections}
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return recording, found


@pytest.mark.slow
@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", PROFILES)
def test_every_path_of_the_layout_is_a_number_in_the_profile_s_mcap(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    recording, messages = first_messages(name, tmp_path)
    layout = layout_of(recording.layout)
    for path in paths(layout):
        topic, _, inner = path.partition(".")
        at(messages[topic][-1], inner)
    panels = layout["configById"]
    assert panels["3D!scene"]["topics"].keys() <= messages.keys()
    frames = {
        t.header.frame_id for topic in ("/tf", "/tf_static") for m in messages.get(topic, ()) for t in m.transforms
    }
    frames |= {marker.header.frame_id for m in messages.get("/scene", ()) for marker in m.markers}
    assert panels["3D!scene"]["followTf"] in frames or not frames
    assert panels["RosOut!events"]["topicToRender"] in messages
    state = panels["StateTransitions!state"]["paths"][0]["value"].partition(".")[2]
    assert at(messages["/loop/cycle"][-1], state) in set(State)
    assert arranged(layout["layout"], panels) == set(panels)


def arranged(node: Any, panels: dict[str, Any]) -> set[str]:
    """The panels of a part of the arrangement."""
    if isinstance(node, str):
        tabs = panels[node].get("tabs", ())
        return {node}.union(*(arranged(tab["layout"], panels) for tab in tabs))
    return arranged(node["first"], panels) | arranged(node["second"], panels)


def test_a_path_is_of_the_number_that_its_label_says(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    recording, messages = first_messages("finger-jog", tmp_path, numbered=True)
    fields = recording.layout.fields
    for name in ("finger.position_command", "finger.position_command.sent", "world.hand_tips"):
        for place, value in enumerate(recording.value(name)[-1].ravel()):
            topic, _, inner = value_path(fields[name], place).partition(".")
            assert at(messages[topic][-1], inner) == value, (name, place)
    labels = fields["finger.position_command"].labels
    (plot,) = (p for p in layout_of(recording.layout)["configById"].values() if p.get("xAxisVal"))
    sent = {p["label"]: p["value"] for p in plot["paths"] if p["label"].endswith("sent")}
    assert sent == {f"{label} sent": f"/finger/position_command/sent.position[{i}]" for i, label in enumerate(labels)}


def test_poses_and_wrenches_have_their_own_paths() -> None:
    layout = Layout(devices=["arm"])
    layout.add("arm.pose", "state", (7,), "m", frame="world")
    layout.add("arm.wrench", "state", (6,), "N", frame="world")
    made = layout.fields
    assert value_path(made["arm.pose"], 3) == "/arm/pose.pose.orientation.w"  # the runtime's fourth is qw
    assert value_path(made["arm.wrench"], 5) == "/arm/wrench.wrench.torque.z"


@pytest.mark.slow
def test_the_settings_are_those_that_foxglove_s_own_types_have() -> None:
    theirs = pytest.importorskip("foxglove.layouts")
    panels = layout_of(wiring.build(*profile.load("human-srl"), []).layout)["configById"]

    def known(kind: type) -> set[str]:
        return set(kind(**{f.name: None for f in dataclasses.fields(kind)})._to_dict())

    own = {"foxglovePanelTitle"}  # the title's name in this form of the file
    for name, config, series in (
        ("3D!scene", theirs.ThreeDeeConfig, None),
        ("Plot!0", theirs.PlotConfig, theirs.PlotSeries),
        ("StateTransitions!state", theirs.StateTransitionsConfig, theirs.StateTransitionsSeries),
    ):
        assert panels[name].keys() - own <= known(config), name
        for path in panels[name].get("paths", ()):
            assert path.keys() <= known(series), name
    camera = theirs.ThreeDeeCameraState
    assert panels["3D!scene"]["cameraState"].keys() <= known(camera)


def test_the_command_writes_it_and_refuses_another_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "jog.json"
    assert main(["check", "servo-jog", "--sim", "--foxglove-layout", str(target)]) == 0
    assert f"{target}: 5 panels" in capsys.readouterr().out
    made = json.loads(target.read_text())
    assert "/world/finger_position.data[0]" in str(paths(made)) or "/finger/position.position[0]" in str(paths(made))
    assert "doesn't end in .json" in refused("check", "servo-jog", "--foxglove-layout", str(tmp_path / "jog.yaml"))
