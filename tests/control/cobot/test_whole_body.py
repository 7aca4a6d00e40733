"""Kinematics of arm and base, the arm's dynamics with a load, tool-pose, and the 6 x 6 equations behind the laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.control import bound
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.control.cobot.whole_body import ArmDynamics, WholeBody, add_base
from srl.control.shared import spd6
from srl.control.shared.priority import Priority
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import ARMS, PANDA, Payload, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model

MOUNT = (0.2, -0.05, 0.527, 0.96, 0.0, 0.0, 0.28)
TOOL = (0.03, -0.02, 0.15, 0.8, 0.0, 0.6, 0.0)
MOUNTED, HELD = rotation.homogeneous(MOUNT), rotation.homogeneous(TOOL)


def postures(robot: RobotDescription, total: int, seed: int = 1) -> Array:
    """(total, 3 + n): a base anywhere, an arm within its limits."""
    rng = np.random.default_rng(seed)
    low, high = np.maximum(robot.q_lower, -3), np.minimum(robot.q_upper, 3)
    return np.hstack([rng.uniform([-5, -5, -4], [5, 5, 4], (total, 3)), rng.uniform(low, high, (total, robot.n))])


def expected(robot: RobotDescription, q: Array) -> Array:
    """(4, 4), the control point in the world, multiplied out."""
    here = np.eye(4)
    here[:3, :3] = Rotation.from_euler("z", q[2]).as_matrix()
    here[:3, 3] = q[0], q[1], 0.0
    return np.array(here @ MOUNTED @ robot.forward(q[3:]) @ HELD)


@pytest.mark.parametrize("robot", ARMS.values(), ids=ARMS)
def test_pose_and_jacobian_are_those_of_the_multiplied_out_chain(robot: RobotDescription) -> None:
    body, step = WholeBody(robot, MOUNTED, HELD), 1e-6
    for q in postures(robot, 20):
        body.update(q)
        want = expected(robot, q)
        np.testing.assert_allclose(body.position, want[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotation.matrix(body.orientation), want[:3, :3], atol=1e-12)
        assert body.orientation[0] >= 0
        assert body.jacobian.shape == (6, 3 + robot.n)
        for i, unit in enumerate(np.eye(len(q))):
            a, b = expected(robot, q - step * unit), expected(robot, q + step * unit)
            turn = Rotation.from_matrix(b[:3, :3] @ a[:3, :3].T).as_rotvec()
            column = np.concatenate([b[:3, 3] - a[:3, 3], turn]) / (2 * step)
            np.testing.assert_allclose(body.jacobian[:, i], column, atol=1e-8)


def tool_pose(robot: str = "panda") -> ToolPose:
    return bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=MOUNT, tool=TOOL)


@pytest.mark.parametrize("yaw", [0.0, 1.0, np.pi / 2, -2.5])
def test_the_bases_twist_is_taken_in_its_own_frame(yaw: float) -> None:
    """The twist is how the pose changes as the base drives on."""
    controller, dt, twist, qd = tool_pose(), 1e-6, np.array([0.4, -0.2, 0.7]), 0.1 * np.arange(7)
    ends = []
    for side in (-0.5, 0.5):
        turn = yaw + side * dt * twist[2]
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = side * dt * (c * twist[0] - s * twist[1]), side * dt * (s * twist[0] + c * twist[1])
        controller.input["base_pose"][:] = x, y, turn
        controller.input["q"][:] = PANDA.home + side * dt * qd
        controller.update(1e-3)
        ends.append(controller.output["pose"].copy())
    controller.input["base_pose"][:] = 0, 0, yaw
    controller.input["base_twist"][:] = twist
    controller.input["q"][:], controller.input["qd"][:] = PANDA.home, qd
    controller.reset()
    a, b = (Rotation.from_quat(end[[4, 5, 6, 3]]) for end in ends)
    np.testing.assert_allclose(controller.output["twist"][:3], (ends[1][:3] - ends[0][:3]) / dt, atol=1e-8)
    np.testing.assert_allclose(controller.output["twist"][3:], (b * a.inv()).as_rotvec() / dt, atol=1e-8)


def test_a_yawed_base_drives_the_tool_sideways() -> None:
    controller = tool_pose()
    controller.input["base_pose"][2] = np.pi / 2
    controller.input["q"][:] = PANDA.home
    controller.input["base_twist"][0] = 0.3
    controller.update(1e-3)
    np.testing.assert_allclose(controller.output["twist"], [0, 0.3, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_documented_shapes_and_units(name: str) -> None:
    n, controller = ARMS[name].n, tool_pose(name)
    shapes = {s.name: (s.shape, s.unit) for s in (*controller.inputs, *controller.outputs)}
    assert shapes == {
        "q": ((n,), "rad"), "qd": ((n,), "rad/s"), "base_pose": ((3,), "m, rad"), "base_twist": ((3,), "m/s, rad/s"),
        "pose": ((7,), "m"), "twist": ((6,), "m/s, rad/s"), "jacobian": ((6, 3 + n), "1"),
    }  # fmt: skip


def test_an_unknown_arm_is_named_with_its_neighbours() -> None:
    with pytest.raises(ValueError, match=r"'pandaa'.*'panda'"):
        ToolPoseConfig.model_validate({"robot": "pandaa"})


# -- dynamics


@pytest.mark.parametrize("robot", ARMS.values(), ids=ARMS)
def test_dynamics_are_pinocchios_own(robot: RobotDescription) -> None:
    dynamics, model = ArmDynamics(robot), pinocchio_model(robot)
    data, rng = model.createData(), np.random.default_rng(2)
    for q in postures(robot, 10)[:, 3:]:
        qd = rng.uniform(-1, 1, robot.n)
        upper = np.triu(pin.crba(model, data, q))
        M = upper + np.triu(upper, 1).T
        gravity = pin.computeGeneralizedGravity(model, data, q).copy()
        coriolis = pin.computeCoriolisMatrix(model, data, q, qd) @ qd
        np.testing.assert_allclose(dynamics.inverse_mass(q) @ M, np.eye(robot.n), atol=1e-8)
        for own, speed in ((False, False), (False, True), (True, False), (True, True)):
            found = dynamics.bias(q, qd, gravity=own, coriolis=speed)
            np.testing.assert_allclose(found, own * gravity + speed * coriolis, atol=1e-9)


def test_a_load_adds_its_weight_and_inertia_by_its_share_and_goes_again() -> None:
    load, q, still = Payload(3.0, (0.01, 0.02, 0.1)), PANDA.home, np.zeros(7)
    dynamics = ArmDynamics(PANDA, load)
    empty = dynamics.inverse_mass(q)
    place, model = PANDA.forward(q), pinocchio_model(PANDA)
    J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED)
    at = place[:3, :3] @ np.array(load.com)
    Jc = J[:3] - np.cross(at[:, None], J[3:], axis=0)  # of the centre of mass
    for share in (0.3, 1.0):
        dynamics.carry(share)
        found = dynamics.bias(q, still, gravity=False, coriolis=True)
        np.testing.assert_allclose(found, Jc.T @ [0, 0, share * 3.0 * 9.81], atol=1e-10)
        M = np.linalg.inv(empty) + share * 3.0 * Jc.T @ Jc
        np.testing.assert_allclose(dynamics.inverse_mass(q) @ M, np.eye(7), atol=1e-8)
    dynamics.carry(0.0)
    np.testing.assert_array_equal(dynamics.inverse_mass(q), empty)
    np.testing.assert_array_equal(dynamics.bias(q, still, gravity=False, coriolis=True), 0)


def test_gravity_follows_the_arms_mounting() -> None:
    hanging = ArmDynamics(PANDA, None, (0.0, 1.0, 0.0, 0.0))
    upright = ArmDynamics(PANDA)
    found = [d.bias(PANDA.home, np.zeros(7), gravity=True, coriolis=False) for d in (hanging, upright)]
    np.testing.assert_allclose(found[0], -found[1], atol=1e-12)


# -- priority


def test_priority_blends_and_keeps_the_posture_of_the_switch() -> None:
    priority, dt = Priority(2, 0.5), 0.01
    start, later = np.array([1.0, 2.0]), np.array([1.5, 1.0])
    priority.reset(False, start)
    np.testing.assert_array_equal(priority.preferred, start)
    before, levels = priority.preferred.copy(), []
    for _ in range(60):
        priority.update(True, later, dt)
        assert np.abs(priority.preferred - before).max() <= 1.0 * dt / 0.5 + 1e-12
        before = priority.preferred.copy()
        levels.append(priority.between(0, 1))
    np.testing.assert_allclose(priority.preferred, later)
    assert np.diff([0, *levels]).max() == pytest.approx(dt / 0.5)
    assert levels[-1] == 1
    assert priority.between_ratios(5, 1) == 1
    priority.update(False, start, 0.25)
    assert priority.between_ratios(4, 1) == pytest.approx(2)
    np.testing.assert_allclose(priority.preferred, later)  # it goes on pulling there while it fades


# -- equations


def spd(rng: np.random.Generator, spread: float) -> Array:
    root = rng.normal(size=(6, 6)) * np.exp(rng.uniform(-spread, spread, 6))
    return np.array(root @ root.T)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 3))
def test_equations_are_solved(seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    A, b = spd(rng, spread), rng.normal(size=6)
    x, independence = spd6.Equations().damped(A, b)
    limit = 1e-13 * np.linalg.cond(A) * np.abs(np.linalg.solve(A, b)).max()
    np.testing.assert_allclose(spd6.Equations().solve(A, b), np.linalg.solve(A, b), atol=limit)
    if independence >= spd6.NEAR:
        np.testing.assert_array_equal(x, spd6.Equations().solve(A, b))
    assert independence == pytest.approx(np.linalg.det(A) / np.prod(np.diag(A)), rel=1e-6, abs=1e-14)
    assert spd6.Equations().determinant(A) == pytest.approx(np.linalg.det(A), rel=1e-6)


@pytest.mark.parametrize("rank", [0, 1, 3, 5])
def test_a_singular_matrix_gives_something_finite_and_small_where_the_equations_can_be_met(rank: int) -> None:
    rng = np.random.default_rng(rank)
    root = rng.normal(size=(6, rank))
    A = root @ root.T
    b = A @ rng.normal(size=6)
    x = spd6.Equations().damped(A, b)[0]
    assert np.isfinite(x).all()
    np.testing.assert_allclose(A @ x, b, atol=1e-2 * max(1.0, np.abs(b).max()))
    assert spd6.Equations().determinant(A) < 1e-12


def test_what_is_no_number_stays_none() -> None:
    A = np.eye(6)
    for at in ((0, 0), (5, 1), (3, 3)):
        broken = A.copy()
        broken[at] = np.nan
        x, independence = spd6.Equations().damped(broken, np.ones(6))
        assert not np.isfinite(independence)
        assert np.isnan(x).all()


def test_damping_comes_in_without_a_step() -> None:
    rng = np.random.default_rng(3)
    root, b = rng.normal(size=(6, 6)), rng.normal(size=6)
    b = b / np.abs(b).max()

    def at(size: float) -> Array:
        A = root * np.array([1, 1, 1, 1, 1, size])
        A = A @ A.T
        return A @ spd6.Equations().damped(A, A @ b)[0]

    sizes = np.exp(np.linspace(np.log(1e-5), 0, 4000))
    steps = [np.abs(at(a) - at(c)).max() for a, c in zip(sizes[1:], sizes[:-1], strict=True)]
    assert max(steps) < 0.05


def test_the_bases_part_is_added_as_the_jacobian_says() -> None:
    q: Any = postures(PANDA, 1)[0]
    body = WholeBody(PANDA, MOUNTED, HELD)
    body.update(q)
    A = np.zeros((6, 6))
    add_base(A, body.jacobian, 0.3, 0.7)
    Jb = body.jacobian[:, :3]
    np.testing.assert_allclose(np.tril(A), np.tril(Jb @ np.diag([0.3, 0.3, 0.7]) @ Jb.T), atol=1e-12)
