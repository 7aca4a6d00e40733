"""The robots' descriptions against the fact sheets, and their two models against each other."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from ruamel.yaml import YAML

from srl.runtime.models.robots import ARMS, FR3, PANDA, SUMMIT_XL, UR16E, Payload, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, mobile_model, pinocchio_model
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_arm


def sheet(name: str) -> dict[str, Any]:
    content: dict[str, Any] = YAML(typ="safe").load(shared(f"facts/{name}.yaml"))
    return content


def cases(name: str) -> list[tuple[str, dict[str, Any]]]:
    return list(sheet(name)["reference"]["configurations"].items())


def mass_matrix(model: Any, data: Any, q: np.ndarray) -> np.ndarray:
    upper = np.triu(pin.crba(model, data, q))
    return upper + np.triu(upper, 1).T


def mujoco_model(robot: RobotDescription) -> tuple[Any, Any]:
    mjcf = Mjcf()
    add_arm(mjcf, mjcf.worldbody, robot, "arm", 0.0, 0.0)
    root = Element("mujoco")
    add(root, "compiler", angle="radian", autolimits=True)
    root.extend((mjcf.worldbody, mjcf.actuator))
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("robot", [PANDA, UR16E], ids=lambda robot: robot.name)
def test_reference_values_of_the_sheet(robot: RobotDescription) -> None:
    model = pinocchio_model(robot)
    data = model.createData()
    panda = robot is PANDA
    # The sheet's UR16e comes from a description with rounded right angles, and gives eight decimals.
    digits = 1e-9 if panda else 1e-8
    turn = np.eye(3) if panda else np.diag([-1.0, -1.0, 1.0])  # the sheet's Jacobian is in base_link's axes
    for name, want in cases(robot.name):
        q, dq = np.array(want["q"]), np.array(want["dq_for_coriolis"])
        place = np.array(want["T_base_flange" if panda else "T_base_tool0"])
        gravity = pin.computeGeneralizedGravity(model, data, q).copy()
        coriolis = pin.nonLinearEffects(model, data, q, dq) - gravity
        jacobian = pin.computeFrameJacobian(model, data, q, model.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED)
        expected = np.array(want["jacobian_flange_base_axes" if panda else "jacobian_tool0_base_link_axes"])
        suffix = "_arm" if panda else ""
        np.testing.assert_allclose(robot.forward(q), place, atol=digits, err_msg=name)
        np.testing.assert_allclose(mass_matrix(model, data, q), want["mass_matrix" + suffix], atol=digits)
        np.testing.assert_allclose(gravity, want["gravity" + suffix], atol=digits)
        np.testing.assert_allclose(coriolis, want["coriolis" + suffix], atol=digits)
        np.testing.assert_allclose(jacobian, np.kron(np.eye(2), turn) @ expected, atol=digits)


@pytest.mark.parametrize("robot", ARMS.values(), ids=ARMS)
def test_pinocchio_and_mujoco_agree(robot: RobotDescription) -> None:
    ours = pinocchio_model(robot, rotors=True)
    data = ours.createData()
    theirs, state = mujoco_model(robot)
    flange, rng = theirs.body("arm/flange").id, np.random.default_rng(7)
    for _ in range(20):
        q, dq = rng.uniform(robot.q_lower, robot.q_upper), rng.uniform(-robot.dq_max, robot.dq_max)
        state.qpos[:], state.qvel[:] = q, dq
        mujoco.mj_forward(theirs, state)
        matrix, jacobian = np.zeros((robot.n, robot.n)), np.zeros((6, robot.n))
        for i, unit in enumerate(np.eye(robot.n)):
            mujoco.mj_mulM(theirs, state, matrix[i], unit)
        mujoco.mj_jacBody(theirs, state, jacobian[:3], jacobian[3:], flange)
        pin.framesForwardKinematics(ours, data, q)
        place = data.oMf[ours.getFrameId(FLANGE)]
        np.testing.assert_allclose(state.xpos[flange], place.translation, atol=1e-9)
        np.testing.assert_allclose(state.xmat[flange].reshape(3, 3), place.rotation, atol=1e-9)
        np.testing.assert_allclose(robot.forward(q), place.homogeneous, atol=1e-9)
        np.testing.assert_allclose(
            jacobian,
            pin.computeFrameJacobian(ours, data, q, ours.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED),
            atol=1e-9,
        )
        np.testing.assert_allclose(matrix, mass_matrix(ours, data, q), atol=1e-9)
        np.testing.assert_allclose(state.qfrc_bias, pin.nonLinearEffects(ours, data, q, dq), atol=1e-9)
        np.testing.assert_allclose(state.qfrc_gravcomp, pin.computeGeneralizedGravity(ours, data, q), atol=1e-9)


def test_limits_are_those_of_the_sheets() -> None:
    limits = sheet("panda")["joint_limits"]
    names = {"q_min": "q_lower", "q_max": "q_upper", "dq_max": "dq_max", "ddq_max": "ddq_max"}
    names |= {"dddq_max": "dddq_max", "tau_max": "tau_max", "dtau_max": "dtau_max"}
    for theirs, ours in names.items():
        np.testing.assert_array_equal(getattr(PANDA, ours), limits[theirs])
    limits = sheet("ur16e")["joint_limits"]
    np.testing.assert_allclose(UR16E.dq_max, limits["dq_max"], atol=1e-9)
    np.testing.assert_array_equal(UR16E.tau_max, limits["tau_max"])
    assert UR16E.q_upper[2] == pytest.approx(limits["elbow_practical"])


@pytest.mark.parametrize("robot", ARMS.values(), ids=ARMS)
def test_documented_shapes(robot: RobotDescription) -> None:
    for name in (
        *("q_lower", "q_upper", "dq_max", "ddq_max", "dddq_max", "tau_max", "dtau_max"),
        *("rotor_inertia", "dry_friction", "stiffness", "inertia", "home"),
    ):
        values = getattr(robot, name)
        assert values.shape == (robot.n,)
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0.0
    assert np.all(robot.q_lower < robot.home)
    assert np.all(robot.home < robot.q_upper)
    assert len(robot.labels) == robot.n


def test_payload_adds_its_weight_at_its_place() -> None:
    q, payload = FR3.home, Payload(2.0, (0.01, -0.02, 0.1))
    bare, loaded = pinocchio_model(FR3), pinocchio_model(FR3, payload=payload)
    place = FR3.forward(q)
    arm = place[:3, :3] @ np.array(payload.com)
    jacobian = pin.computeFrameJacobian(bare, bare.createData(), q, bare.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED)
    weight = np.array([0.0, 0.0, 2.0 * 9.81])
    added = jacobian.T @ np.concatenate([weight, np.cross(arm, weight)])
    gravity = [pin.computeGeneralizedGravity(model, model.createData(), q) for model in (bare, loaded)]
    np.testing.assert_allclose(gravity[1] - gravity[0], added, atol=1e-12)


def test_mobile_model_is_the_arm_carried_by_the_base() -> None:
    mount = np.eye(4)
    mount[:3, 3] = 0.2, 0.0, 0.5
    model = mobile_model(SUMMIT_XL, PANDA, mount)
    data = model.createData()
    q = np.concatenate([[1.0, -2.0, np.pi / 2], PANDA.home])
    pin.framesForwardKinematics(model, data, q)
    here = np.array([[0.0, -1, 0, 1], [1, 0, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(
        data.oMf[model.getFrameId(FLANGE)].homogeneous, here @ mount @ PANDA.forward(PANDA.home), atol=1e-12
    )
    matrix = mass_matrix(model, data, q)
    carried = SUMMIT_XL.mass + PANDA.base.mass + sum(joint.link.mass for joint in PANDA.joints)
    assert matrix[0, 0] == pytest.approx(carried)
    arm = pinocchio_model(PANDA)
    np.testing.assert_allclose(matrix[3:, 3:], mass_matrix(arm, arm.createData(), PANDA.home), atol=1e-12)


def test_the_pandas_friction_is_the_law_that_was_published() -> None:
    law = sheet("panda")["friction_gaz2019"]
    span, steepness, offset = (np.array(law[name]) for name in ("phi1", "phi2", "phi3"))
    assert PANDA.sliding_friction is not None
    dq = np.linspace(-3, 3, 61)[:, None] * np.ones(7)
    want = span / (1 + np.exp(-steepness * (dq + offset))) - span / (1 + np.exp(-steepness * offset))
    np.testing.assert_allclose(PANDA.sliding_friction.torque(dq), want, atol=1e-9)
    assert (PANDA.sliding_friction.damping(dq) > 0).all()


def test_the_pandas_rotors_are_the_makers() -> None:
    """The reflected inertias that the README of Drake's franka_description lists for the FR3."""
    want = [0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064]
    for robot in (PANDA, FR3):
        np.testing.assert_array_equal(robot.rotor_inertia, want)


@given(arrays(float, 3, elements=st.floats(-5, 5)))
def test_mecanum_kinematics_are_each_others_inverse(twist: np.ndarray) -> None:
    np.testing.assert_allclose(SUMMIT_XL.twist(*SUMMIT_XL.wheels(*twist)), twist, atol=1e-12)


def test_mecanum_kinematics_of_the_sheet() -> None:
    facts = sheet("summit_xl_steel")
    for pair in facts["kinematics"]["reference"]:
        np.testing.assert_allclose(SUMMIT_XL.wheels(*pair["twist"]), pair["wheels"], atol=1e-8)
        np.testing.assert_allclose(SUMMIT_XL.twist(*pair["wheels"]), pair["twist"], atol=1e-8)
    assert SUMMIT_XL.mass == facts["mass_paper"]
    assert SUMMIT_XL.wheel_radius == facts["wheel"]["radius"]
    assert pytest.approx(23.6, abs=0.05) == SUMMIT_XL.wheel_speed
