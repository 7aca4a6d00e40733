"""Arms from URDFs: their models against Pinocchio's and MuJoCo's own readers, and what can't be."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.arm_urdf import ALL, HIP, TIPS, XACRO
from pydantic import ValidationError

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_chain

RNG = np.random.default_rng(5)


def model(text: str, **more: Any) -> RobotModel:
    return RobotModel.model_validate({"urdf": KeptFile(Path("arm.urdf"), text.encode()), **more})


def whole(matrix: np.ndarray) -> np.ndarray:
    upper = np.triu(matrix)
    return upper + np.triu(upper, 1).T


def places(robot: Any, count: int = 8) -> list[np.ndarray]:
    return list(RNG.uniform(np.maximum(robot.q_lower, -3.0), np.minimum(robot.q_upper, 3.0), (count, robot.n)))


@pytest.mark.parametrize("style", ALL)
def test_it_is_the_arm_that_pinocchio_reads(style: str) -> None:
    entry = model(ALL[style], tip=TIPS[style])
    robot, base = entry.robot, entry.arm.base
    ours = pinocchio_model(robot)
    theirs = pin.buildModelFromXML(ALL[style])
    start = pin.neutral(theirs)
    held = [theirs.getJointId(name) for name in entry.arm.held]
    for joint in held:  # at the nearest to zero that their limits let them
        start[theirs.joints[joint].idx_q] = 0.01
    theirs = pin.buildReducedModel(theirs, held, start)
    data, other = ours.createData(), theirs.createData()
    tip = theirs.getFrameId(entry.arm.tip)
    root = pin.updateFramePlacement(theirs, other, theirs.getFrameId(base)).inverse()
    ours.gravity.linear = root.rotation @ theirs.gravity.linear
    for q in places(robot):
        v = RNG.uniform(-1.0, 1.0, robot.n)
        theirs_q = np.concatenate(
            [(np.cos(value), np.sin(value)) if joint.nq == 2 else (value,)
             for value, joint in zip(q, list(theirs.joints)[1:], strict=True)]
        )  # fmt: skip
        pin.framesForwardKinematics(theirs, other, theirs_q)
        expected = (root * other.oMf[tip]).homogeneous
        assert robot.forward(q) == pytest.approx(expected, abs=1e-12)
        pin.framesForwardKinematics(ours, data, q)
        assert data.oMf[ours.getFrameId(FLANGE)].homogeneous == pytest.approx(expected, abs=1e-12)
        assert whole(pin.crba(ours, data, q)) == pytest.approx(whole(pin.crba(theirs, other, theirs_q)), abs=1e-12)
        want = pin.nonLinearEffects(theirs, other, theirs_q, v)
        assert pin.nonLinearEffects(ours, data, q, v) == pytest.approx(want, abs=1e-11)


@pytest.mark.parametrize("style", ["hip", "exported"])
def test_the_simulated_arm_is_the_one_that_mujoco_reads(style: str) -> None:
    robot = model(ALL[style], tip=TIPS[style]).robot
    bare = re.sub(r"<collision>.*?</collision>", "", ALL[style])  # it would look for the meshes
    theirs = mujoco.MjModel.from_xml_string(bare)
    mjcf, root = Mjcf(), Element("mujoco")
    add_chain(mjcf, mjcf.worldbody, robot, "arm", {name: {} for name in robot.labels})
    add(root, "compiler", angle="radian", autolimits=True)
    root.append(mjcf.worldbody)
    ours = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    data, other = mujoco.MjData(ours), mujoco.MjData(theirs)
    names = [theirs.joint(name).dofadr[0] for name in robot.labels]
    for q in places(robot):
        data.qpos[:], other.qpos[names] = q, q
        data.qvel[:] = other.qvel[:] = RNG.uniform(-1.0, 1.0, robot.n)
        other.qvel[names] = data.qvel
        M, N = np.zeros((robot.n, robot.n)), np.zeros((robot.n, robot.n))
        for m, d, out in ((ours, data, M), (theirs, other, N)):
            mujoco.mj_forward(m, d)
            mujoco.mj_fullM(m, out, d.qM) if hasattr(d, "qM") else mujoco.mj_fullM(m, d, out)
        assert pytest.approx(N[np.ix_(names, names)], abs=1e-9) == M
        assert data.qfrc_bias == pytest.approx(other.qfrc_bias[names], abs=1e-8)
        place = data.body("arm/flange")
        assert robot.forward(q)[:3, 3] == pytest.approx(place.xpos, abs=1e-9)


def test_a_point_mass_can_be_simulated_and_is_doubted() -> None:
    """As some write it: a mass, and zeros for its inertia. A ball as contact shape has no length."""
    point = re.sub(r"<cylinder.*?/>", '<sphere radius="0.04"/>', HIP)
    point = point.replace('ixx="2e-4" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"', "", 1)
    assert point != HIP
    robot = model(point, tip="tool").robot
    assert any("l3" in warning and "osmium" in warning for warning in robot.warnings)
    mjcf, root = Mjcf(), Element("mujoco")
    add_chain(mjcf, mjcf.worldbody, robot, "arm", {name: {} for name in robot.labels})
    root.append(mjcf.worldbody)
    made = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    inertia = made.body_inertia[made.body("arm/elbow").id]
    assert made.body_mass[made.body("arm/elbow").id] == pytest.approx(0.4)
    assert (inertia > 0.0).all()
    assert (inertia < 1e-6).all()


def test_limits_are_the_files_and_the_entrys_where_it_has_any() -> None:
    robot = model(HIP, tip="tool", limits={"elbow": {"upper": 1.0, "velocity": 2.0}}, home={"elbow": 0.5}).robot
    assert robot.q_upper.tolist() == [1.5, 2.0, 1.0, 2.4]
    assert robot.dq_max.tolist() == [6.0, 6.0, 2.0, 6.0]
    assert robot.tau_max.tolist() == [18.0, 18.0, 9.0, 6.0]
    assert robot.home.tolist() == [0.0, 0.0, 0.5, 0.0]
    assert not robot.warnings


def test_a_gripper_behind_the_tip_is_carried_as_it_stands() -> None:
    entry = model(XACRO, tip="tool0", base="base_link")
    assert entry.robot.labels == ("pan", "lift", "elbow")
    assert entry.arm.held == ("left", "right")
    assert entry.robot.joints[-1].link.mass == pytest.approx(1.1)
    assert any("left, right" in text for text in entry.remarks())


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('value="0.7"', 'value="-0.7"', "link l2: a mass of -0.7 kg"),
        ('ixx="4e-4"', 'ixx="-4e-4"', "link l2.*not positive definite"),
        ('izz="2e-3"', 'izz="9e-3"', "link l3.*none is more than the others' sum"),
        ('<limit lower="-2" upper="2"', "<limit", "joint shoulder has no position limits"),
        ('type="revolute"><parent link="l1"', 'type="floating"><parent link="l1"', "joint shoulder.*'floating'"),
        ('velocity="6"/></joint>', 'velocity="6"/><mimic joint="wrist"/></joint>', "yaw follows 'wrist'"),
        ('<link name="tool"', '<link name="l4"', "two links are called 'l4'"),
        ('name="wrist"', 'name="yaw"', "two joints are called 'yaw'"),
        ('mass value="0.7"', 'mass value="heavy"', "link l2: mass: 'heavy' isn't 1 numbers"),
    ],
)
def test_what_can_not_be_is_refused(old: str, new: str, reason: str) -> None:
    with pytest.raises((OptionError, ValidationError), match=reason):
        model(HIP.replace(old, new, 1), tip="tool")


@pytest.mark.parametrize(
    ("old", "new", "warning"),
    [
        ('xyz="0.25 0 0"', 'xyz="250 0 0"', "joint elbow is 250 m.*millimetres"),
        ('upper="1.5"', 'upper="90"', "joint yaw: its limit upper is 90 rad.*degrees"),
        ('velocity="6"', 'velocity="180"', "joint yaw: its limit velocity is 180 rad/s.*degrees"),
        ('effort="18"', 'effort="0"', "joint yaw has no effort limit"),
        ('value="0.7"', 'value="700"', "link l2 has 700 kg. Are these grams"),
    ],
)
def test_what_is_probably_wrong_is_doubted(old: str, new: str, warning: str) -> None:
    assert any(re.search(warning, found) for found in model(HIP.replace(old, new, 1), tip="tool").robot.warnings)


def test_prefixes_that_nothing_declares_are_read_past() -> None:
    """As in published files of the UR arms."""
    text = HIP.replace('<limit lower="-1.5"', '<limit drake:acceleration="2.5" lower="-1.5"', 1)
    text = text.replace("</robot>", "<xyz:gazebo/></robot>")
    assert model(text, tip="tool").robot.q_lower[0] == -1.5


def test_inertias_in_other_units_are_doubted() -> None:
    warnings = model(HIP.replace('"5e-3"', '"5e3"'), tip="tool").robot.warnings
    assert any(re.search("link l2: 0.7 kg with 5e.03 kg m.2 would be", found) for found in warnings)
    text = HIP.replace("2e-4", "2e-9").replace("1e-4", "1e-9")
    assert any("osmium" in found for found in model(text, tip="tool").robot.warnings)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"tip": "hand"}, "no link 'hand' for 'tip'"),
        ({"base": "tool", "tip": "l1"}, "'l1' doesn't hang on 'tool'"),
        ({"base": "l4", "tip": "tool"}, "nothing moves between l4 and tool"),
        (
            {"tip": "tool", "limits": {"elbo": {"velocity": 1.0}}},
            "'elbo' of 'limits' doesn't move.*Did you mean 'elbow'",
        ),
        ({"tip": "tool", "home": {"elbow": 3.0}}, "home of elbow, 3, isn't within"),
        ({"tip": "tool", "capsules": {"l9": []}}, "no link 'l9' for 'capsules'"),
    ],
)
def test_an_entry_that_does_not_fit_is_refused(more: dict[str, Any], reason: str) -> None:
    with pytest.raises((OptionError, ValidationError), match=reason):
        model(HIP, **more)


def test_a_forest_of_chains_asks_for_the_tip() -> None:
    with pytest.raises((OptionError, ValidationError), match=r"2 chains of joints.*tip"):
        model(XACRO.replace('<mimic joint="left"/>', ""))


def test_kinematics_alone_are_enough_for_a_law_that_only_needs_these() -> None:
    robot = model(re.sub(r"<inertial>.*?</inertial>", "", HIP), tip="tool").robot
    assert robot.weightless == robot.labels
    with pytest.raises(OptionError, match="nothing behind the joint 'yaw'"):
        robot.with_masses()


def test_shapes_are_capsules_that_hold_the_files() -> None:
    robot = model(HIP, tip="tool").robot
    (box,) = robot.joints[1].shape
    assert box.radius == pytest.approx(np.hypot(0.025, 0.025))
    ends = np.array([robot.joints[1].placement[:3, :3] @ np.array(end) for end in (box.start, box.end)])
    assert sorted(np.round(ends[:, 0], 9)) == [0.0, 0.25]
    assert model(ALL["exported"]).robot.unseen == ("base_link", "Part_1", "Part_2", "Part_3")
