"""Plots: what references mean, their errors, and the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.recording import make_layout, make_rows
from matplotlib import image
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.errors import RecordingError, WiringError
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.pictures import figure
from srl.runtime.pictures.camera import look
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.plots import Plot, command_plots, joint_plots, series_names
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.shapes import visuals


def test_lines_pick_elements_and_distances_are_euclidean() -> None:
    layout = make_layout()
    rows = make_rows(layout, 50)
    tips, tip, q = (layout.value(rows, name) for name in ("hand.tips", "world.tip", "world.finger"))
    plot = Plot(
        title="p",
        unit="m",
        lines={"a": "hand.tips[index,2]", "old": "hand.tips[1,2]", "q": "world.finger"},
        distance={"d": ("hand.tips[0]", "world.tip")},
    )
    curves = plot.curves(layout, rows)
    assert list(curves) == ["a", "old", "q abduction", "q mcp", "q pip", "q dip", "d"]
    assert np.array_equal(curves["a"], tips[:, 1, 2])
    assert np.array_equal(curves["old"], curves["a"])  # recordings of earlier versions
    assert np.array_equal(curves["q pip"], q[:, 2])
    assert np.allclose(curves["d"], np.sqrt(((tips[:, 0] - tip) ** 2).sum(axis=1)), rtol=1e-14)


def test_series_are_named_by_labels_and_axes() -> None:
    layout = make_layout()
    assert series_names(layout, "hand.tips")[3:6] == ["index x", "index y", "index z"]
    assert series_names(layout, "mapping.sphere") == ["x", "y", "z", "radius"]
    assert series_names(layout, "world.finger") == ["abduction", "mcp", "pip", "dip"]


@pytest.mark.parametrize(
    ("lines", "distance", "reason"),
    [
        ({"a": "world.fingr"}, {}, "Did you mean 'world.finger'"),
        ({"a": "world.finger[4]"}, {}, "shaped \\(4,\\)"),
        ({"a": "world.finger[pib]"}, {}, "has no 'pib'.*Did you mean 'pip'"),
        ({"a": "world.finger[pip,0]"}, {}, "Name fewer axes"),
        ({}, {"d": ("hand.tips", "world.tip")}, "not \\(3,\\)"),
    ],
)
def test_wrong_references_say_what_is_wrong(
    lines: dict[str, str], distance: dict[str, tuple[str, str]], reason: str
) -> None:
    layout = make_layout()
    with pytest.raises(RecordingError, match=reason):
        Plot(title="p", unit="m", lines=lines, distance=distance).curves(layout, make_rows(layout, 3))


def test_a_profile_names_components_and_numbers_what_has_slots() -> None:
    world = wiring.build(*profile.load("base-jog"), []).layout.fields["world.base_outline"]
    assert (world.slots, world.components) == (True, (("x", "y", "z"),))
    for reference in ("world.base_outline[3,y]", "world.base_pose[yaw]"):
        plots = f"record={{plots: [{{title: p, unit: m, lines: {{a: '{reference}'}}}}]}}"
        kept = wiring.build(*profile.load("base-jog", [plots]), []).layout.meta["record"]["plots"]
        assert kept[0]["lines"] == {"a": reference}
    plots = "record={plots: [{title: p, unit: m, lines: {a: 'world.base_outline[3,1]'}}]}"
    with pytest.raises(WiringError, match=r"1 is a place\. Write one of: x, y, z"):
        wiring.build(*profile.load("base-jog", [plots]), [])


def test_a_plot_of_nothing_is_refused() -> None:
    with pytest.raises(ValidationError, match="needs 'lines' or 'distance'"):
        Plot(title="p", unit="m")


def measured_layout() -> tuple[Layout, np.ndarray]:
    """The made-up run with a finger whose joints are measured, and its limits."""
    layout = make_layout(extra=1)
    layout.add("world.finger_position", "truth", (4,), "rad")
    layout.meta["limits"] = {"finger.position_command": {"lower": [0.0] * 4, "upper": [1.0] * 4}}
    rows = make_rows(layout, 3000)
    field = layout.fields["world.finger_position"]
    start = layout.ints + field.offset
    rows[:, start : start + 4] = layout.value(rows, "world.finger").view(np.int64)
    return layout, rows


def test_each_element_of_a_command_is_plotted_as_asked_applied_and_measured() -> None:
    layout, rows = measured_layout()
    plots = command_plots(layout)
    assert [p.title for p in plots] == [f"finger.position {j}" for j in ("abduction", "mcp", "pip", "dip")]
    curves = plots[2].curves(layout, rows)
    for label, name in (
        ("asked", "finger.position_command"),
        ("applied", "finger.position_command.applied"),
        ("simulated", "world.finger"),
    ):
        assert np.array_equal(curves[label], layout.value(rows, name)[:, 2])
    # What the device itself measures goes before the world's truth; another unit is another quantity.
    layout.add("finger.position", "state", (4,), "rad")
    assert command_plots(layout)[0].lines["measured"] == "finger.position[0]"
    assert "simulated" not in command_plots(layout)[0].lines
    del layout.fields["finger.position"]
    layout.add("finger.position", "state", (4,), "1")
    assert command_plots(layout)[0].lines["simulated"] == "world.finger_position[0]"
    assert "measured" not in command_plots(layout)[0].lines  # nobody could measure it on hardware
    assert not {"measured", "simulated"} & command_plots(make_layout())[0].lines.keys()


def test_the_panels_plot_says_what_isnt_measured() -> None:
    layout, _ = measured_layout()
    assert [plot.title for plot in joint_plots(layout)] == ["finger.position (simulated)"]
    layout.add("finger.position", "state", (4,), "rad")
    assert [plot.title for plot in joint_plots(layout)] == ["finger.position"]
    assert [plot.title for plot in joint_plots(make_layout())] == ["finger.position (applied)"]


def test_what_is_measured_in_another_order_is_found_by_name() -> None:
    layout = make_layout()
    layout.add("finger.position", "state", (4,), "rad", labels=("dip", "pip", "mcp", "thumb"))
    lines = {plot.title: plot.lines.get("measured") for plot in command_plots(layout)}
    assert lines["finger.position mcp"] == "finger.position[mcp]"
    assert lines["finger.position abduction"] is None  # it isn't measured


@pytest.mark.slow
def test_the_picture_shows_commands_plots_states_and_timing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout, rows = measured_layout()
    rows[2500:, layout.int_names.index("state")] = State.STOPPED
    rows[2500:, layout.int_names.index("cause")] = Cause.INTENT_LOSS
    rows[2500:, layout.int_names.index("fault_source")] = 0
    shown: list[Any] = []
    monkeypatch.setattr(figure.plt, "close", shown.append)
    figure.draw(Recording(Path("x.rrd"), layout, np.arange(1, 3001), rows, [(10, 12)], [], 0), tmp_path / "x.png")
    assert image.imread(tmp_path / "x.png")[..., :3].std() > 0.05  # not blank
    assert "3000 cycles in 3.0 s" in shown[0].get_suptitle()
    assert "3 rows missing" in shown[0].get_suptitle()
    panels = {axis.get_title(loc="left"): axis for axis in shown[0].axes}
    assert {"finger.position mcp", "Finger", "Distance of the tips", "Age of the devices' samples"} <= panels.keys()
    lines = {line.get_label(): line for line in panels["finger.position mcp"].get_lines()}
    assert lines.keys() == {"asked", "applied", "simulated", "limit"}
    drawn, true = lines["applied"].get_ydata(), layout.value(rows, "finger.position_command.applied")[:, 1]
    assert (drawn.min(), drawn.max()) == (true.min(), true.max())  # thinned, but no peak is lost
    assert [text.get_text() for text in shown[0].axes[0].texts][-1] == "intent loss glove"
    monkeypatch.undo()
    figure.plt.close("all")


BOUNDS = {"lower": [-0.3], "upper": [0.2], "velocity": [0.4], "acceleration": [0.1], "effort": [0.5]}


@pytest.mark.parametrize("reported", [True, False])  # recordings of earlier versions don't say what a command commands
@pytest.mark.parametrize(
    ("kind", "unit", "expected"),
    [
        ("position", "rad", {-0.3, 0.2}),
        ("position", "1", {-0.3, 0.2}),
        ("velocity", "rad/s", {-0.4, 0.4}),
        ("velocity", "m/s, rad/s", {-0.4, 0.4}),
        ("torque", "N m", {-0.5, 0.5}),
        ("torque", "N", {-0.5, 0.5}),
    ],
)
def test_a_command_has_the_limits_of_its_own_quantity(
    kind: str, unit: str, expected: set[float], reported: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = Layout()
    layout.add("arm.command", "command", (1,), unit, labels=("joint",))
    layout.meta = {"limits": {"arm.command": BOUNDS}} | (
        {"commands": {"arm.command": {"kind": kind}}} if reported else {}
    )
    rows = np.zeros((100, layout.width), np.int64)
    rows[:, layout.int_names.index("now")] = np.arange(100) * 1_000_000
    rows[:, layout.ints] = np.linspace(-1.0, 1.0, 100).view(np.int64)
    shown: list[Any] = []
    monkeypatch.setattr(figure.plt, "close", shown.append)
    monkeypatch.setattr(figure.plt.Figure, "savefig", lambda *_, **__: None)  # most of the time
    figure.draw(Recording(Path("x.rrd"), layout, np.arange(1, 101), rows, [], [], 0), tmp_path / "x.png")
    panel = next(axis for axis in shown[0].axes if axis.get_title(loc="left") == "arm.command joint")
    drawn = {float(line.get_ydata()[0]) for line in panel.get_lines() if line.get_label() == "limit"}
    assert drawn == expected
    monkeypatch.undo()
    figure.plt.close("all")


def test_an_axis_has_the_unit_of_its_own_element() -> None:
    base = wiring.build(*profile.load("moca-man"), []).layout
    assert {p.title: p.unit for p in command_plots(base) if "base" in p.title} == {
        "base.twist vx": "m/s",
        "base.twist vy": "m/s",
        "base.twist wz": "rad/s",
    }
    assert "base.twist (m/s, rad/s)" in {f"{p.title} ({p.unit})" for p in joint_plots(base)}
    arm = {p.title: p.unit for p in command_plots(wiring.build(*profile.load("human-srl"), []).layout)}
    assert (arm["arm.position J4"], arm["arm.position J5"]) == ("rad", "m")  # J5 slides


@pytest.mark.parametrize("profile_name", ["moca-man", "kairos-man"])
def test_a_profile_says_what_its_commands_command(profile_name: str) -> None:
    graph = wiring.build(*profile.load(profile_name), [])
    commands = graph.layout.meta["commands"]
    assert commands == {a.name: {"kind": a.command.kind.value} for a in graph.actuators}
    assert commands["base.twist_command"] == {"kind": "velocity"}
    assert commands["hand.position_command"] == {"kind": "position"}
    assert (commands.get("arm.torque_command") == {"kind": "torque"}) == (profile_name == "moca-man")


def test_a_picture_that_cannot_be_written_says_why(tmp_path: Path) -> None:
    layout = Layout()
    rows = np.zeros((2, layout.width), np.int64)
    for word in ("now", "wake", "write"):
        rows[:, layout.int_names.index(word)] = [0, 1_000_000]
    with pytest.raises(RecordingError, match="can't be written"):
        figure.draw(Recording(Path("x.rrd"), layout, np.arange(1, 3), rows, [], [], 0), tmp_path / "no" / "x.png")


def test_the_eye_sees_all_that_is_shown_in_the_root_frame() -> None:
    layout = make_layout()
    row = make_rows(layout, 1, 2000)[0]
    eye = look(layout, row, visuals(layout))
    assert eye is not None
    position, target = (np.array(v.as_arrow_array()[0].as_py()) for v in (eye.position, eye.look_target))
    pose = layout.value(row, "hand.pose")
    mount = Rotation.from_euler("z", 0.5)
    rotation = mount * Rotation.from_quat([*pose[4:], pose[3]])
    origin = mount.apply(pose[:3]) + np.array([0.1, 0, 0])
    points = rotation.apply(layout.value(row, "hand.tips")) + origin
    centre, radius = np.split(layout.value(row, "mapping.sphere"), [3])
    centre = rotation.apply(centre) + origin
    forward = (target - position) / np.linalg.norm(target - position)
    half = np.deg2rad(27.5)  # rerun's field of view is 55 degrees high
    thing = layout.meta["scenery"][0]
    corner = np.array(thing["position"]) + thing["size"]
    for p, margin in [*((p, 0.0) for p in points), (centre, radius[0]), (corner, 0.0)]:
        way = p - position
        off = np.arccos(way @ forward / np.linalg.norm(way)) + np.arcsin(margin / np.linalg.norm(way))
        assert off < half
    row[:] = 0  # before the first sample
    assert look(layout, row, visuals(layout)) is None
