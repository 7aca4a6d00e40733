"""Chains against the reference fingertips of the fact sheet and against pinocchio."""

from __future__ import annotations

from math import pi

import numpy as np
import pinocchio as pin
import pytest
from helpers.control import finger_tip, hand_chains, hand_tips
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from ruamel.yaml import YAML

from srl.control.shared.kinematics import Chain
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS, RANGES, hand_geometry
from srl.runtime.models.point_series import PointSeries

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


chain = st.integers(1, 6).flatmap(
    lambda n: st.tuples(
        arrays(float, (2, n, 2), elements=st.sampled_from([0.0, pi / 2, -pi / 2, 0.7, -1.6, 0.03])),
        arrays(float, (2, n), elements=angle),
    )
)


@given(chain, arrays(float, (2, 3), elements=angle))
def test_chains_agree_with_pinocchio(rows_q: tuple[Array, Array], rpy: Array) -> None:
    """One by one with their Jacobian, and both at once; parallel and turned axes among them."""
    rows, q = rows_q
    bases = np.tile(np.eye(4), (2, 1, 1))
    bases[:, :3, :3] = [pin.rpy.rpyToMatrix(*angles) for angles in rpy]
    bases[:, :3, 3] = rpy[:, ::-1]
    n = rows.shape[1]
    ends = PointSeries(bases, rows).at(q.ravel()).reshape(2, n, 3)
    for k in range(2):
        one = Chain(bases[k], rows[k])
        tip, expected = pinocchio_tip(bases[k], rows[k], q[k])
        np.testing.assert_allclose(one.forward(q[k].tolist()), tip, atol=1e-12)
        np.testing.assert_allclose(np.array(one.jacobian()).T, expected[:3], atol=1e-12)
        np.testing.assert_allclose(ends[k], one.points[1:], atol=1e-12)
        np.testing.assert_array_equal(one.points[0], bases[k, :3, 3])


def test_jacobian_is_the_derivative() -> None:
    q, h = np.linspace(-0.2, 1.0, 20).reshape(5, 4), 1e-6
    for one, at in zip(hand_chains(), q, strict=True):
        one.forward(at.tolist())
        J = np.array(one.jacobian()).T
        for j, dq in enumerate(h * np.eye(4)):
            numeric = np.subtract(one.forward((at + dq).tolist()), one.forward((at - dq).tolist())) / (2 * h)
            np.testing.assert_allclose(J[:, j], numeric, atol=1e-9)


@pytest.mark.parametrize("rows", [((0.0, 0.05),), ((0.3, 0.0), (-0.8, 0.02), (1.1, 0.03), (0.2, 0.01))])
def test_points_of_unequal_chains_keep_apart(rows: tuple[tuple[float, float], ...]) -> None:
    n = len(rows)
    series = PointSeries(np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])]), np.array([rows, rows]))
    q = np.linspace(0.1, 0.9, n)
    still, moved = series.at(np.r_[q, q]), series.at(np.r_[q, q + 1.0])
    np.testing.assert_array_equal(still[:n], moved[:n])
    np.testing.assert_allclose(still[n:], still[:n] * [-1.0, -1.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("posture", ["zero", "flex30", "santello_mean", "abd10", "fist"])
def test_hand_reaches_the_reference_tips(posture: str) -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["reference"][posture]
    tips = hand_tips(np.deg2rad(sheet["q_deg"]).ravel()) * 1e3
    np.testing.assert_allclose(tips, [sheet["tips_mm"][f] for f in FINGERS], atol=2e-6)


@pytest.mark.parametrize("posture", ["zero", "flex30", "flex60", "abd20", "mix"])
def test_sixth_finger_reaches_the_reference_tips(posture: str) -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["sixth_finger"]["reference"][posture]
    tip = finger_tip(np.deg2rad(sheet["q_deg"])) * 1e3
    np.testing.assert_allclose(tip, sheet["tip_mm"], atol=2e-6)


def test_ranges_are_the_recommended_ones() -> None:
    sheet = YAML(typ="safe").load(shared("facts/human_hand.yaml"))["joint_ranges_deg"]["recommended_20dof"]
    ranges = np.deg2rad(np.concatenate([sheet[f] for f in FINGERS]))
    np.testing.assert_allclose(RANGES, ranges)


def test_hand_scales_with_its_length() -> None:
    q = np.linspace(0.0, 1.0, 20)
    small, large = PointSeries(*hand_geometry()), PointSeries(*hand_geometry(0.2079))
    np.testing.assert_allclose(large.at(q), 1.1 * small.at(q), rtol=1e-12)
