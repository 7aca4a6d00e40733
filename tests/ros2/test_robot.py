"""The robot as ROS expects it: one tree of frames, all joints once, and a URDF that another library reads alike."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from srl.runtime.contracts import rotation
from srl.runtime.contracts.linkage import Link, Linkage
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.messages import cdr, messages
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.robots import FixedRobots, Robot, robots
from srl.runtime.recording.shapes import Placing
from srl.runtime.ros2.joints import Joints, moved_by_devices
from srl.runtime.ros2.tree import Tree, frame_of
from srl.runtime.ros2.urdf import description

PROFILES = ("human-srl", "moca-man", "kairos-man", "sixth-finger", "servo-jog", "so101")
WALL = 1_700_000_000_000_000_000


class Run:
    """A profile some cycles after its begin."""

    def __init__(self, name: str) -> None:
        graph = wiring.build(*profile.load(name), [])
        step = Lockstep(graph)
        for _ in range(round(0.3 * graph.layout.meta["rate"][0] / graph.layout.meta["rate"][1])):
            step.step()
        self.layout: Layout = graph.layout
        self.row = graph.row.words.copy()
        found = moved_by_devices(robots(self.layout), self.layout)
        self.joints, self.tree = Joints(self.layout, found), Tree(self.layout, found)
        self.robots = found

    def poses(self) -> dict[str, np.ndarray]:
        """T (4, 4) of each frame in its root, by walking the published transforms."""
        given = [*self.tree.static(0)["transforms"], *self.tree.moving(self.row, WALL)["transforms"]]
        own = {}
        for t in given:
            p, q = t["transform"]["translation"], t["transform"]["rotation"]
            pose = (p["x"], p["y"], p["z"], q["w"], q["x"], q["y"], q["z"])
            assert t["child_frame_id"] not in own, "a frame has one parent"
            own[t["child_frame_id"]] = t["header"]["frame_id"], rotation.homogeneous(pose)
        placed: dict[str, np.ndarray] = {}

        def place(frame: str) -> np.ndarray:
            if frame not in own:
                return np.eye(4)
            if frame not in placed:
                parent, T = own[frame]
                placed[frame] = place(parent) @ T
            return placed[frame]

        return {frame: place(frame) for frame in own}


def limited(layout: Layout, limits: dict[str, Any]) -> Layout:
    """The layout with these limits of its commands."""
    return replace(layout, meta=layout.meta | {"limits": limits})


@pytest.fixture(scope="module", params=PROFILES)
def run(request: pytest.FixtureRequest) -> Run:
    return Run(request.param)


def test_each_link_is_in_tf_where_the_pictures_draw_it(run: Run) -> None:
    poses, known = run.poses(), 0
    drawn = {robot.name: robot.angles for robot in robots(run.layout)}
    for robot, places in zip(run.robots, FixedRobots(run.layout).of(run.row), strict=True):
        if robot.angles and robot.angles != drawn[robot.name]:
            continue  # the picture has the simulation's truth, of a limb that measures nothing
        for number in range(len(robot.linkage.links)):
            if np.isfinite(places[number]).all() and (frame := frame_of(robot, number)) in poses:
                np.testing.assert_allclose(poses[frame], places[number], atol=1e-9)
                known += 1
    assert known > 0 or not run.robots or run.layout.meta["name"] == "sixth-finger"


def test_each_frame_of_the_profile_is_in_tf_where_the_laws_have_it(run: Run) -> None:
    poses = run.poses()
    links = {frame_of(robot, i) for robot in run.robots for i in range(len(robot.linkage.links))}
    placing = Placing(run.layout)
    for frame in set(placing.frames) - links:
        T = placing.to_root(run.row, frame)
        if frame in poses and np.isfinite(T).all():
            np.testing.assert_allclose(poses[frame], T, atol=1e-9)


def test_all_joints_are_there_once_with_what_is_measured(run: Run) -> None:
    found = run.joints.message(run.row, WALL)
    assert found is not None
    stamp, message = found
    assert len(set(message["name"])) == len(message["name"]) == len(message["position"])
    assert stamp >= WALL
    sent = cdr.decode(messages.JOINT_STATE, cdr.encode(messages.JOINT_STATE, message))
    assert sent["name"] == list(message["name"])
    assert sent["header"]["stamp"] == {"sec": stamp // 10**9, "nanosec": stamp % 10**9}


def test_another_library_reads_the_urdf_and_has_the_links_where_tf_has_them(run: Run) -> None:
    limits = {name: {"lower": [-2.0] * 30, "upper": [2.0] * 30} for name in run.layout.meta["commands"]}
    text = description("robot", limited(run.layout, limits), run.tree, run.joints)
    root = ET.fromstring(text)
    links = [link.get("name") for link in root.findall("link")]
    joints = [joint.get("name") for joint in root.findall("joint")]
    assert len(set(links)) == len(links)
    assert len(set(joints)) == len(joints)
    if not run.robots:
        return
    model = pin.buildModelFromXML(text)
    data = model.createData()
    _, message = run.joints.message(run.row, WALL) or (0, {})
    value = dict(zip(message["name"], message["position"], strict=True))
    poses = run.poses()
    q = pin.neutral(model)
    for number in range(1, model.njoints):
        name, place = model.names[number], model.joints[number].idx_q
        kind = model.joints[number].shortname()
        if kind == "JointModelFreeFlyer":
            edge = next(e for e in run.tree.edges if f"{e.child}_joint" == name)
            T = (
                np.linalg.inv(rotation.homogeneous(edge.pose))
                @ np.linalg.inv(poses.get(edge.parent, np.eye(4)))
                @ poses.get(edge.child, poses.get(edge.parent, np.eye(4)) @ rotation.homogeneous(edge.pose))
            )
            w, x, y, z = rotation.from_matrix(T[:3, :3])
            q[place : place + 7] = (*T[:3, 3], x, y, z, w)
        elif model.joints[number].nq == 2:  # without limits
            q[place : place + 2] = np.cos(value[name]), np.sin(value[name])
        else:
            q[place] = value[name]
    pin.framesForwardKinematics(model, data, q)
    compared = 0
    for robot in run.robots:
        for number in range(len(robot.linkage.links)):
            frame = frame_of(robot, number)
            if frame in poses and model.existFrame(frame, pin.BODY):
                made = data.oMf[model.getFrameId(frame, pin.BODY)].homogeneous
                np.testing.assert_allclose(made, poses[frame], atol=1e-6, err_msg=frame)
                compared += 1
    assert compared > 1


@pytest.mark.parametrize("name", ["human-srl", "so101"])
def test_limits_are_the_guards(name: str) -> None:
    run = Run(name)
    (command,) = (name for name in run.layout.meta["commands"] if name.endswith("position_command"))
    labels = run.layout.fields[command].labels
    n = np.arange(1.0, len(labels) + 1)
    limits = {"lower": list(-n), "upper": list(2 * n), "velocity": list(3 * n), "effort": list(4 * n)}
    text = description("robot", limited(run.layout, {command: limits}), run.tree, run.joints)
    found = {joint.get("name"): joint.find("limit") for joint in ET.fromstring(text).findall("joint")}
    for label, number in zip(labels, n, strict=True):
        limit = found[label]
        assert limit is not None
        made = [float(limit.get(key, "nan")) for key in ("lower", "upper", "velocity", "effort")]
        assert made == [-number, 2 * number, 3 * number, 4 * number]


def test_where_the_guard_has_no_limit_a_joint_goes_round_and_a_slide_goes_far() -> None:
    run = Run("human-srl")
    joints = ET.fromstring(description("robot", limited(run.layout, {}), run.tree, run.joints)).findall("joint")
    own = [joint for joint in joints if joint.get("name") in run.joints.names]
    assert {joint.get("type") for joint in own} == {"continuous", "prismatic"}
    (slide,) = [limit for joint in own for limit in joint.findall("limit")]
    assert [slide.get(key) for key in ("lower", "upper", "velocity", "effort")] == ["-1000", "1000", "1000", "1000"]


def test_what_is_not_known_is_not_said() -> None:
    made = Run("human-srl")
    row = made.row.copy()
    place = made.layout.ints + made.layout.fields["arm.position"].offset
    row[place : place + 1] = np.array([np.nan]).view(np.int64)
    frames = {t["child_frame_id"] for t in made.tree.moving(row, WALL)["transforms"]}
    assert "arm/J1" not in frames
    assert "arm/J2" in frames


def test_before_its_first_sample_a_joint_is_not_a_number() -> None:
    made = Run("moca-man")
    row = made.row.copy()
    index = made.layout.devices.index("hand")
    row[made.layout.device(index).start] = -1  # its stamp
    _, message = made.joints.message(row, WALL) or (0, {})
    value = dict(zip(message["name"], message["position"], strict=True))
    assert np.isfinite([value[f"joint{i}"] for i in range(1, 8)]).all()
    assert np.isnan(value["closure"])
    assert np.isnan([v for name, v in value.items() if "thumb" in name]).all()


def test_two_links_that_follow_one_value_are_two_joints() -> None:
    layout = Run("servo-jog").layout
    links = (
        Link("base", -1),
        Link("one", 0, joint="proximal"),
        Link("two", 0, joint="proximal"),
        Link("distal", 1, joint="distal", factor=-1.0, offset=0.5),
    )
    robot = Robot("finger", Linkage(links), "finger.position", "", ())
    joints, tree = Joints(layout, [robot]), Tree(layout, [robot])
    assert len(set(joints.names)) == len(joints.names) == 4
    limits = {"finger.position_command": {"lower": [-1, -2], "upper": [1, 3], "velocity": [2, 2]}}
    root = ET.fromstring(description("robot", limited(layout, limits), tree, joints))
    found = {joint.get("name"): joint for joint in root.findall("joint")}
    assert len(found) == len(root.findall("joint"))
    mimics = {m.get("joint") for joint in found.values() for m in joint.findall("mimic")}
    assert mimics == {"proximal"}
    (limit,) = [j.find("limit") for j in found.values() if j.find("child").get("link") == "finger/distal"]  # type: ignore[union-attr]
    assert (float(limit.get("lower")), float(limit.get("upper"))) == (-2.5, 2.5)  # type: ignore[union-attr, arg-type]


def test_a_frame_of_a_law_is_said_only_while_the_laws_run() -> None:
    made = Run("moca-man")

    def frames(state: State) -> set[str]:
        row = made.row.copy()
        row[CYCLE.state] = state
        return {t["child_frame_id"] for t in made.tree.moving(row, WALL)["transforms"]}

    assert "tool" in frames(State.ACTIVE)
    assert "tool" not in frames(State.STOPPED)
    assert "base" in frames(State.STOPPED), "odometry goes on"


def test_a_urdf_of_the_profile_keeps_its_looks(tmp_path: Path) -> None:
    (tmp_path / "own.urdf").write_text(
        '<robot name="own"><material name="sea"><color rgba="0 0 1 1"/></material><link name="one"><visual><geometry>'
        '<mesh filename="m.stl"/></geometry><material name="sea"/></visual></link></robot>'
    )
    layout = Run("servo-jog").layout
    robot = Robot(
        "finger", Linkage((Link("one", -1, joint="proximal"),)), "finger.position", str(tmp_path / "own.urdf"), ()
    )
    text = description("robot", limited(layout, {}), Tree(layout, [robot]), Joints(layout, [robot]))
    root = ET.fromstring(text)
    (mesh,) = root.iter("mesh")
    assert mesh.get("filename") == (tmp_path / "m.stl").as_uri()
    assert [m.get("name") for m in root.findall("material")] == ["sea"]
