"""Chains against the reference fingertips of the fact sheet and against pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from helpers_shared import shared
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from ruamel.yaml import YAML

from runtime.control.extra_finger import ExtraFinger, FingerKinematics
from runtime.control.human_hand import FINGERS, JOINTS, LOWER, UPPER, hand_chains
from runtime.control.kinematics import Chains
from runtime.signals import Array

angle = st.floats(-3.2, 3.2)


def pinocchio_tip(base: Array, rows: Array, q: Array) -> tuple[Array, Array]:
    """Tip (3,) and Jacobian (6, n), world-aligned, of the same chain built from pinocchio's joints."""
    model, parent = pin.Model(), 0
    place = pin.SE3(base[:3, :3], base[:3, 3])
    for j, (alpha, a) in enumerate(rows):
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"j{j}")
        place = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, 0.0]))
    tip = model.addFrame(pin.Frame("tip", parent, 0, place, pin.FrameType.OP_FRAME))
    data = model.createData()
    J = pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
    pin.updateFramePlacements(model, data)
    return data.oMf[tip].translation, J.reshape(6, -1)


@given(
    st.integers(1, 6).flatmap(
        lambda n: st.tuples(
            arrays(float, (2, n, 2), elements=st.floats(-1.6, 1.6)), arrays(float, (2, n), elements=angle)
        )
    ),
    arrays(float, (2, 3), elements=angle),
)
def test_chains_agree_with_pinocchio(rows_q: tuple[Array, Array], rpy: Array) -> None:
    rows, q = rows_q
    bases = np.tile(np.eye(4), (2, 1, 1))
    bases[:, :3, :3] = [pin.rpy.rpyToMatrix(*angles) for angles in rpy]
    bases[:, :3, 3] = rpy[:, ::-1]
    chains = Chains(bases, rows)
    tips, J = chains.forward(q).copy(), chains.jacobian()
    for k in range(2):
        tip, expected = pinocchio_tip(bases[k], rows[k], q[k])
        np.testing.assert_allclose(tips[k], tip, atol=1e-12)
        np.testing.assert_allclose(J[k], expected, atol=1e-12)


def test_jacobian_is_the_derivative() -> None:
    hand, q = hand_chains(), np.linspace(-0.2, 1.0, 20).reshape(5, 4)
    hand.forward(q)
    J, h = hand.jacobian()[:, :3].copy(), 1e-6
    for j in range(4):
        dq = np.zeros((5, 4))
        dq[:, j] = h
        numeric = (hand.forward(q + dq).copy() - hand.forward(q - dq)) / (2 * h)
        np.testing.assert_allclose(J[:, :, j], numeric, atol=1e-9)


@pytest.mark.parametrize("posture", ["zero", "flex30", "santello_mean", "abd10", "fist"])
def test_hand_reaches_the_reference_tips(posture: str) -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["reference"][posture]
    tips = hand_chains().forward(np.deg2rad(sheet["q_deg"]).reshape(5, 4)) * 1e3
    np.testing.assert_allclose(tips, [sheet["tips_mm"][f] for f in FINGERS], atol=2e-6)


@pytest.mark.parametrize("posture", ["zero", "flex30", "flex60", "abd20", "mix"])
def test_sixth_finger_reaches_the_reference_tips(posture: str) -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["sixth_finger"]["reference"][posture]
    tip = FingerKinematics(ExtraFinger(), 0.01).tip(np.deg2rad(sheet["q_deg"])) * 1e3
    np.testing.assert_allclose(tip, sheet["tip_mm"], atol=2e-6)


def test_ranges_are_the_recommended_ones() -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["joint_ranges_deg"]["recommended_20dof"]
    ranges = np.deg2rad(np.concatenate([sheet[f] for f in FINGERS]))
    np.testing.assert_allclose(np.stack([LOWER, UPPER], axis=1), ranges)


def test_hand_scales_with_its_length() -> None:
    q = np.linspace(0.0, 1.0, 20).reshape(5, 4)
    np.testing.assert_allclose(hand_chains(0.2079).forward(q), 1.1 * hand_chains().forward(q), rtol=1e-12)


def test_simulated_hand_agrees() -> None:
    """The simulation wrote the same hand a second time: names, ranges."""
    hand = pytest.importorskip("sim.hand")
    assert hand.JOINTS == JOINTS
    np.testing.assert_allclose(hand.RANGES, np.stack([LOWER, UPPER], axis=1))
