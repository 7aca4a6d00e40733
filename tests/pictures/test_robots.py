"""Robots in a recording: the frames in the file, against Pinocchio's forward kinematics at the recorded angles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import rerun as rr
from helpers.urdf import URDF, write_urdf

from srl.runtime.contracts.rotation import homogeneous, matrices
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.models.robots import PANDA, SUMMIT_XL, UR16E
from srl.runtime.models.robots.pinocchio_model import mobile_model, pinocchio_model
from srl.runtime.profile import profile, wiring
from srl.runtime.recorder import blueprint
from srl.runtime.recorder.scene import VIEW_RATE
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.reader import read
from srl.runtime.recording.shapes import Placing


def layout_of(text: str, folder: Path) -> Layout:
    file = folder / "robots.yaml"
    file.write_text(text)
    return wiring.build(*profile.load(str(file))).layout


def made_rows(layout: Layout, count: int, rate: float = 1000.0, **values: Array) -> Words:
    """Rows of a run at a rate, Hz, with these values (count, n) of signals; `a__b` is the signal a.b."""
    rows = np.zeros((count, layout.width), np.int64)
    rows[:, layout.int_names.index("cycle")] = np.arange(count)
    for word in ("now", "wake"):
        rows[:, layout.int_names.index(word)] = 10**9 + (np.arange(count) * 1e9 / rate).astype(np.int64)
    for name, given in values.items():
        field = layout.fields[name.replace("__", ".")]
        start = layout.ints + field.offset
        rows[:, start : start + field.size] = np.ascontiguousarray(given).view(np.int64)
    return rows


def write(layout: Layout, rows: Words, folder: Path, batch: int = 200) -> tuple[Path, list[str]]:
    layout.save(folder / "layout.json")
    stream = Stream((folder / "layout.json").read_text())
    stream.recording.save(folder / "run.rrd")
    stream.prologue(rows[-1])
    for at in range(0, len(rows), batch):
        stream.rows(np.arange(at, min(at + batch, len(rows))) + 1, rows[at : at + batch])
    stream.recording.disconnect()
    return folder / "run.rrd", stream.problems


class Frames:
    """The frames of a file: each child's pose in its parent, by cycle, as the viewer takes them."""

    def __init__(self, file: Path) -> None:
        self.fixed: dict[str, tuple[str, Array]] = {}
        self.moved: dict[int, dict[str, tuple[str, Array]]] = {}
        self.paths: set[str] = set()
        self.bytes = 0
        for chunk in rr.chunk.RrdReader(file).stream():
            batch = chunk.to_record_batch()
            self.paths.add(chunk.entity_path)
            columns: dict[str, list[Any]] = {}
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                columns[name.rpartition(":")[2]] = column.to_pylist()
            if "child_frame" not in columns:
                continue
            for i, child in enumerate(columns["child_frame"]):
                T = np.eye(4)
                T[:3, 3] = columns["translation"][i][0]
                if "quaternion" in columns:
                    x, y, z, w = columns["quaternion"][i][0]
                    T[:3, :3] = matrices(np.array([[w, x, y, z]]))[0]
                else:
                    T[:3, :3] = np.reshape(columns["mat3x3"][i][0], (3, 3), order="F")
                edge = (columns["parent_frame"][i][0], T)
                if chunk.is_static:
                    self.fixed[child[0]] = edge
                else:
                    assert chunk.entity_path == "/tf"
                    self.moved.setdefault(columns["cycle"][i], {})[child[0]] = edge
            if not chunk.is_static:
                self.bytes += batch.nbytes

    def place(self, frame: str, cycle: int) -> Array:
        """The frame in the root's, at a cycle that has rows."""
        T = np.eye(4)
        edges = self.fixed | self.moved[cycle]
        while frame != "tf#/":
            frame, above = edges[frame]
            T = above @ T
        return T


def test_an_arm_on_a_moving_base_stands_where_pinocchio_has_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    layout = wiring.build(*profile.load("moca-man")).layout
    q = rng.uniform(-1.5, 1.5, (600, 7))
    pose = np.column_stack([rng.uniform(-3.0, 3.0, (600, 2)), rng.uniform(-7.0, 7.0, 600)])
    rows = made_rows(layout, 600, arm__position=q, base__pose=pose)
    file, problems = write(layout, rows, tmp_path)
    frames = Frames(file)
    mount = homogeneous(Placing(layout).frames["arm"].placed())
    base = layout.meta["robots"][1]
    assert base["name"] == "base"
    model = mobile_model(SUMMIT_XL, PANDA, mount)
    data = model.createData()
    assert len(frames.moved) > 15
    for cycle in frames.moved:
        pin.framesForwardKinematics(model, data, np.concatenate([pose[cycle], q[cycle]]))
        for joint in (1, 4, 7):
            expected = data.oMi[model.getJointId(f"joint{joint}")].homogeneous
            assert frames.place(f"arm:joint{joint}", cycle) == pytest.approx(expected, abs=2e-6)  # the viewer's float32
        flange = data.oMf[model.getFrameId("flange")].homogeneous
        assert frames.place("arm:flange", cycle) == pytest.approx(flange, abs=2e-6)
        under = data.oMf[model.getFrameId("base")].homogeneous
        assert frames.place("base:base", cycle)[:3, 3] == pytest.approx(under[:3, 3], abs=2e-6)
    assert problems == []
    assert {"/robot-arm/joint4/capsule", "/robot-base/base/box", "/robot-base/base/cylinder"} <= frames.paths
    assert np.array_equal(read(file).rows, rows)  # only the picture is thinned


def test_the_picture_is_thinned_to_the_newest_row_of_each_thirtieth(tmp_path: Path) -> None:
    layout = wiring.build(*profile.load("panda-jog")).layout
    count = 3000
    q = np.tile(np.linspace(-1.0, 1.0, count)[:, None], 7)
    rows = made_rows(layout, count, arm__position=q)
    file, _ = write(layout, rows, tmp_path, batch=count)
    frames = Frames(file)
    now = layout.header(rows, "now")
    bins = now // int(1e9 / VIEW_RATE)
    newest = {int(np.flatnonzero(bins == b)[-1]) for b in np.unique(bins)}
    assert set(frames.moved) - {0} == newest - {0}  # the first row is there, too
    last = frames.place("arm:joint1", count - 1)
    assert np.arctan2(last[1, 0], last[0, 0]) == pytest.approx(1.0, abs=1e-6)
    # Every row of every joint would be rate / 30 as many.
    assert sum(len(f) for f in frames.moved.values()) == pytest.approx(7 * count * VIEW_RATE / 1000.0, rel=0.05)


TWO = """
name: two
rate: 500
devices:
  left: {driver: ur, port: tcp://192.168.56.101}
  right: {driver: ur, port: tcp://192.168.56.102}
setpoints:
  client.left: {shape: [6], unit: rad/s, labels: [JOINTS]}
  client.right: {shape: [6], unit: rad/s, labels: [JOINTS]}
controllers:
  - use: velocity-setpoint
    name: one
    axes: [JOINTS]
    in: {target: client.left}
    out: {velocity: left.velocity_command}
  - use: velocity-setpoint
    name: other
    axes: [JOINTS]
    in: {target: client.right}
    out: {velocity: right.velocity_command}
guard:
  left.velocity_command: {velocity: 0.3, acceleration: 1.0}
  right.velocity_command: {velocity: 0.3, acceleration: 1.0}
stop: {left: brake, right: brake}
frames:
  room: {}
  left: {parent: room, position: [0.0, 0.5, 0.0]}
  right: {parent: room, position: [0.0, -0.5, 0.0], rpy: [0.0, 0.0, 1.0]}
""".replace("JOINTS", "shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3")


def test_two_arms_of_a_kind_have_frames_of_their_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    layout = layout_of(TWO, tmp_path)
    q = {"left": rng.uniform(-2, 2, (40, 6)), "right": rng.uniform(-2, 2, (40, 6))}
    rows = made_rows(layout, 40, 100.0, left__position=q["left"], right__position=q["right"])
    frames = Frames(write(layout, rows, tmp_path)[0])
    model = pinocchio_model(UR16E)
    data = model.createData()
    for side, at in (("left", {"y": 0.5, "yaw": 0.0}), ("right", {"y": -0.5, "yaw": 1.0})):
        stand = homogeneous((0.0, at["y"], 0.0, np.cos(at["yaw"] / 2), 0.0, 0.0, np.sin(at["yaw"] / 2)))
        for cycle in frames.moved:
            pin.framesForwardKinematics(model, data, q[side][cycle])
            flange = stand @ data.oMf[model.getFrameId("flange")].homogeneous
            assert frames.place(f"{side}:flange", cycle) == pytest.approx(flange, abs=2e-6)


@pytest.mark.parametrize(("frames", "drawn"), [(True, 2), (False, 0)])
def test_robots_whose_places_are_not_known_are_not_drawn_into_each_other(
    tmp_path: Path, frames: bool, drawn: int
) -> None:
    layout = layout_of(TWO if frames else TWO[: TWO.index("frames:")], tmp_path)
    assert len(layout.meta["robots"]) == drawn


def test_a_robot_on_a_link_that_nothing_measures_is_not_drawn() -> None:
    real, simulated = (wiring.build(*profile.load("moca-finger"), sim).layout.meta for sim in (None, []))
    # Where the person's hand is, nobody knows.
    assert [robot["name"] for robot in real["robots"]] == ["arm", "base", "gripper"]
    assert [robot["name"] for robot in simulated["robots"]] == ["arm", "base", "finger", "gripper"]


def test_a_base_without_frames_stands_where_it_says_it_is(tmp_path: Path) -> None:
    layout = wiring.build(*profile.load("base-jog")).layout
    rows = made_rows(layout, 20, 50.0, base__pose=np.tile([1.0, 2.0, 0.5], (20, 1)))
    frames = Frames(write(layout, rows, tmp_path)[0])
    assert frames.place("base:base", 19)[:3, 3] == pytest.approx([1.0, 2.0, 0.0], abs=1e-6)


def test_what_is_not_measured_yet_is_not_drawn(tmp_path: Path) -> None:
    layout = wiring.build(*profile.load("sixth-finger")).layout
    (finger,) = layout.meta["robots"]
    assert finger["angles"] == "finger.position_command.applied"  # hobby servos tell nothing
    q = np.full((40, 4), np.nan)
    q[20:] = 0.1
    rows = made_rows(layout, 40, 100.0, finger__position_command__applied=q)
    frames = Frames(write(layout, rows, tmp_path)[0])
    assert min(frames.moved) >= 20
    assert len(frames.moved[39]) == 4


SMALL = """
name: small
rate: 100
devices:
  arm:
    driver: dynamixel
    port: /dev/ttyUSB0
    robot: {urdf: URDF, base: plate, tip: tool}
    motors:
      shoulder: {id: 1, model: MX-28, lower: -1, upper: 1, home: 0}
      slide: {id: 2, model: MX-28, lower: -1, upper: 1, home: 0}
setpoints:
  client.position: {shape: [2], unit: rad, labels: [shoulder, slide]}
controllers:
  - use: joint-setpoint
    joints: [shoulder, slide]
    in: {target: client.position}
    out: {q: arm.position_command, q_velocity: arm.position_command.velocity}
guard: {arm.position_command: {lower: -1, upper: 1, velocity: 1, acceleration: 1}}
stop: {arm: hold}
"""


def drawn_small(folder: Path, text: str = SMALL) -> tuple[Frames, list[str], list[str], Layout]:
    file = folder / "small.yaml"
    file.write_text(text.replace("URDF", "small.urdf"))
    graph = wiring.build(*profile.load(str(file)))
    rows = made_rows(graph.layout, 20, 100.0, arm__position=np.full((20, 2), 0.2))
    recording, problems = write(graph.layout, rows, folder)
    return Frames(recording), problems, graph.warnings, graph.layout


def test_a_users_urdf_is_drawn_with_its_meshes(tmp_path: Path) -> None:
    write_urdf(tmp_path)
    frames, problems, warnings, layout = drawn_small(tmp_path)
    assert (problems, warnings) == ([], [])
    assert "/robot-arm/small/visual_geometries/arm/visual_0" in frames.paths
    assert not any("collision" in path for path in frames.paths)
    assert frames.place("arm:plate", 19) == pytest.approx(np.eye(4), abs=1e-6)  # the base is the device's own frame
    assert frames.moved[19].keys() == {"arm:arm", "arm:tool", "arm:clamp"}
    assert list(layout.meta["files"]) == ["small.urdf"]  # a replay needs no file


def test_a_missing_mesh_is_told_once_and_the_robot_has_plain_shapes(tmp_path: Path) -> None:
    write_urdf(tmp_path, mesh=False)
    frames, problems, warnings, _ = drawn_small(tmp_path)
    assert problems == []
    (warning,) = warnings
    assert "devices.arm.robot" in warning
    assert "package://small/arm.stl of link arm isn't there" in warning
    assert not any("visual_geometries" in path for path in frames.paths)
    assert "/robot-arm/arm/capsule" in frames.paths
    assert frames.moved[19].keys() == {"arm:arm", "arm:tool", "arm:clamp"}


def test_a_mesh_that_goes_after_the_check_costs_the_picture_only(tmp_path: Path) -> None:
    file = write_urdf(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL.replace("URDF", "small.urdf"))
    layout = wiring.build(*profile.load(str(tmp_path / "small.yaml"))).layout
    file.unlink()
    rows = made_rows(layout, 20, 100.0, arm__position=np.full((20, 2), 0.2))
    recording, problems = write(layout, rows, tmp_path)
    assert len(problems) == 1
    assert "it has plain shapes" in problems[0]
    assert "/robot-arm/arm/capsule" in Frames(recording).paths
    assert np.array_equal(read(recording).rows, rows)


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        ("{urdf: none.urdf}", "there is no file"),
        ("{urdf: small.yaml}", "isn't XML"),
        ("{urdf: small.urdf, tip: hand}", "no link 'hand' for 'tip'"),
        ("{urdf: small.urdf, tip: arm}", "1 joints move up to arm, and the robot has 2"),
        ("panda", "the joints of 'panda' aren't those of 'arm'"),
        ("pando", "no robot is called 'pando'. Did you mean 'panda'"),
    ],
)
def test_a_robot_that_cannot_be_used_is_doubted_and_the_profile_stands(tmp_path: Path, robot: str, reason: str) -> None:
    write_urdf(tmp_path)
    frames, problems, warnings, _ = drawn_small(tmp_path, SMALL.replace("{urdf: URDF, base: plate, tip: tool}", robot))
    assert problems == []
    (warning,) = warnings
    assert "small.yaml line 8: devices.arm.robot: " in warning
    assert reason in warning
    assert not frames.moved


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("package://small/arm.stl", "http://[::1", "isn't there"),
        ("package://small/arm.stl", "package://[small/arm.stl", "isn't there"),
        ("package://small/arm.stl", "a" * 5000 + ".stl", "isn't there"),
        ("package://small/arm.stl", "%00.stl", "isn't there"),
        ("package://small/arm.stl", "large.stl", "has more than 100 MiB"),
        ("0.2 0 0", "1e200 0 0", "'1e200 0 0' is beyond 1e+06"),
    ],
)
def test_names_and_numbers_that_no_robot_has_cost_the_picture_only(
    tmp_path: Path, old: str, new: str, reason: str
) -> None:
    write_urdf(tmp_path, text=URDF.replace(old, new))
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate((100 << 20) + 1)
    _, problems, warnings, _ = drawn_small(tmp_path)
    assert problems == []
    (warning,) = warnings
    assert reason in warning
    assert len(warning) < 500


@pytest.mark.parametrize(
    "damage", [{"links": []}, {"links": [{}]}, {"angles": "no.signal"}, {"urdf": 1}, {"name": None}]
)
def test_what_a_damaged_layout_says_of_robots_costs_no_recording(tmp_path: Path, damage: dict[str, Any]) -> None:
    layout = wiring.build(*profile.load("panda-jog")).layout
    layout.meta["robots"][0] |= damage
    rows = made_rows(layout, 10, arm__position=np.zeros((10, 7)))
    assert np.array_equal(read(write(layout, rows, tmp_path)[0]).rows, rows)


def test_every_view_of_a_blueprint_is_in_one_place_and_none_has_more_than_five_plots() -> None:
    for name in ("sixth-finger", "moca-man", "kairos-man", "human-srl"):
        layout = wiring.build(*profile.load(name), []).layout
        made = blueprint.make(layout, None)
        seen: list[Any] = []
        overview: list[Any] = []

        def walk(part: Any, seen: list[Any] = seen, overview: list[Any] = overview) -> None:
            seen.append(part.id)
            if getattr(part, "name", None) == "Overview":
                overview += part.contents
            for inner in getattr(part, "contents", None) or ():
                if hasattr(inner, "id"):
                    walk(inner)

        walk(made.root_container)
        assert len(seen) == len(set(seen)), name
        assert 2 <= len(overview) <= 5, name
