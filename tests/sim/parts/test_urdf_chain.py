"""An arm from a URDF in the cell: a chain of servos with its links; the same entry for pictures and warnings."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.arm_urdf import HIP

from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import Files
from srl.runtime.profile import profile, wiring
from srl.sim.world.cell import Cell

SERVOS = ("yaw", "shoulder", "elbow", "wrist")
LIMB = """
name: limb
rate: 100
models:
  limb: {kind: robot, urdf: arm.urdf, tip: tool, home: {elbow: 0.4}}
devices:
  arm:
    driver: feetech
    port: /dev/ttyUSB0
    robot: limb
    motors: {MOTORS}
controllers:
  - use: posture-cycle
    postures: [{elbow: 0.4, yaw: 0, wrist: 0, shoulder: 0}, {elbow: 0.6, yaw: 0.2, wrist: 0.1, shoulder: 0.1}]
    in: {position: arm.position}
    out: {q: arm.position_command, q_velocity: arm.position_command.velocity}
guard:
  arm.position_command: {velocity: 1, acceleration: 4, lower: -1.5, upper: 1.5}
sim:
  world: cell
  parts: {arm: {part: feetech-chain, robot: limb, axes: {AXES}}}
"""
MOTORS = ", ".join(f"{name}: {{id: {i + 1}, model: STS3215}}" for i, name in enumerate(SERVOS))
AXES = ", ".join(f"{name}: {{model: STS3215}}" for name in reversed(SERVOS))


def graph(folder: Path, text: str = LIMB, urdf: str = HIP, *overrides: str):
    (folder / "arm.urdf").write_text(urdf)
    text = text.replace("MOTORS", MOTORS).replace("AXES", AXES)
    checked, source = profile.parse(str(folder / "limb.yaml"), text, overrides, Files(folder))
    return wiring.build(checked, source, [])


def test_the_chain_is_the_urdfs_arm_with_servos_at_its_joints(tmp_path: Path) -> None:
    made = graph(tmp_path)
    world = made.world
    assert isinstance(world, Cell)
    robot = made.profile.models["limb"].robot
    joints = [world.model.joint(f"arm/{name}") for name in robot.labels]
    assert [joint.range.tolist() for joint in joints] == np.column_stack([robot.q_lower, robot.q_upper]).tolist()
    start = [world.data.qpos[joint.qposadr[0]] for joint in joints]
    assert start == robot.home.tolist()
    for q in np.random.default_rng(3).uniform(robot.q_lower, robot.q_upper, (5, 4)):
        world.data.qpos[[joint.qposadr[0] for joint in joints]] = q
        mujoco.mj_kinematics(world.model, world.data)
        assert world.data.body("arm/flange").xpos == pytest.approx(robot.forward(q)[:3, 3], abs=1e-12)
        assert world.data.body("arm/tip").xpos == pytest.approx(robot.forward(q)[:3, 3], abs=1e-12)


def test_a_run_draws_it_and_keeps_its_file(tmp_path: Path) -> None:
    made = graph(tmp_path)
    (drawn,) = made.layout.meta["robots"]
    assert [link["name"] for link in drawn["links"]] == ["base_link", "l1", "l2", "l3", "l4", "tool"]
    assert made.source.files.kept == {"arm.urdf": HIP.encode()}
    assert not made.warnings
    assert any("1.8 kg move" in text for text in made.remarks)


def test_a_guard_beyond_the_urdf_is_doubted(tmp_path: Path) -> None:
    wide = "guard.arm.position_command.upper=1.6"
    (warning,) = graph(tmp_path, LIMB, HIP, wide).warnings
    assert "beyond hip_arm's: yaw 1.5, and this is 1.6" in warning


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        ("sim.parts.arm.robot=lim", "no arm 'lim'.*'limb'"),
        ("sim.parts.arm.axes.elbow.axis=[0, 0, 1]", "elbow: 'axis' is described by hip_arm"),
        ("sim.parts.arm.axes.elbow.m_per_rad=0.01", "elbow turns in hip_arm"),
        ("sim.parts.arm.axes={elbow: {model: STS3215}}", "the axes aren't the joints of hip_arm"),
        ("models.limb.tip=hand", "no link 'hand'"),
        ("models.limb.urdf=other.urdf", "no file"),
    ],
)
def test_what_does_not_fit_says_where(tmp_path: Path, override: str, reason: str) -> None:
    with pytest.raises(ProfileError, match=reason):
        graph(tmp_path, LIMB, HIP, override)


def test_an_arm_without_masses_can_not_be_simulated(tmp_path: Path) -> None:
    urdf = HIP.replace('mass value="', 'mass value="0" was="')
    for number in ("5e-4", "6e-4", "4e-4", "5e-3", "1e-4", "2e-4", "2e-3"):
        urdf = urdf.replace(f'"{number}"', '"0"')
    with pytest.raises(ProfileError, match="nothing behind the joint 'yaw' of hip_arm has a mass"):
        graph(tmp_path, LIMB, urdf)
