"""A base that gives way: kinematics, the tilt from gravity, the least change of the joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.strap import ARM, AXES, HOME, LOWER, UNIT, UPPER, q_of, share, small, turns, wxyz
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from srl.control.strap.axes import Axes
from srl.control.strap.correction import Correction
from srl.control.strap.tilt import UP_Y, UP_Z, tilt, up_in
from srl.runtime.contracts.rotation import exp


def oracle() -> Any:
    """The same arm for pinocchio."""
    model, parent, place = pin.Model(), 0, np.zeros(3)
    for name, axis in zip(ARM, AXES, strict=True):
        along = np.array(axis.axis) / np.linalg.norm(axis.axis)
        joint = pin.JointModelPrismaticUnaligned(along) if axis.slides else pin.JointModelRevoluteUnaligned(along)
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), place), name)
        place = np.array(axis.link)
    model.addFrame(pin.Frame("tip", parent, 0, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME))
    return model, model.createData()


@given(share)
def test_tip_and_jacobian_are_those_of_an_independent_library(shares):
    q = q_of(shares)
    tip, columns = Axes(AXES).forward(q.tolist())
    model, data = oracle()
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    np.testing.assert_allclose(tip, data.oMf[model.getFrameId("tip")].translation, atol=1e-12)
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED)[:3]
    np.testing.assert_allclose(np.array(columns).T, J, atol=1e-12)


@given(turns, turns, turns, small, st.floats(-3, 3), st.floats(-3, 3))
def test_roll_and_pitch_of_the_base_are_found_whatever_the_yaws_are(body, on_body, on_base, tilted, yaw, other):
    """A base that has turned by t about horizontal axes, sensors mounted anyhow, with references turned anyhow."""
    up = body.inv().apply([0, 0, 1])  # in the axes of the rigid base
    horizontal = tilted - up * up.dot(tilted)
    turned = Rotation.from_rotvec(horizontal)
    references = [Rotation.from_rotvec([0, 0, angle]) for angle in (yaw, other)]
    of_base = references[0] * body * turned * on_base
    of_body = references[1] * body * on_body
    found = tilt(up_in(wxyz(on_base), wxyz(of_base), UP_Z), up_in(wxyz(on_body), wxyz(of_body), UP_Z))
    np.testing.assert_allclose(found, horizontal, atol=1e-6)


@given(turns, turns, turns, st.floats(-1, 1))
def test_yaw_of_the_base_is_not_seen(body, on_body, on_base, yaw):
    twisted = Rotation.from_rotvec([0, 0, yaw]) * body
    found = tilt(up_in(wxyz(on_base), wxyz(twisted * on_base), UP_Z), up_in(wxyz(on_body), wxyz(body * on_body), UP_Z))
    np.testing.assert_allclose(found, 0, atol=1e-7)


def test_a_suits_up_is_y():
    lying = Rotation.from_rotvec([np.pi / 2, 0, 0])  # of the suit's axes (x left, y up, z forward) in z-up axes
    assert np.allclose(up_in(wxyz(lying), tuple(UNIT), UP_Y), [0, 0, 1])


@settings(deadline=None)
@given(share.map(lambda s: [0.25 + 0.5 * v for v in s]), small)
def test_the_tip_stays_where_a_rigid_base_would_put_it(shares, tilted):
    q = q_of(shares)
    correction = Correction(AXES, 0.001)
    base = exp(*tilted)
    for _ in range(5):
        d = correction.solve(q, base)
    beyond = ((q + d < LOWER - 1e-12) | (q + d > UPPER + 1e-12)).any()
    assert not beyond
    J = np.array(Axes(AXES).forward((q + d).tolist())[1])
    at_a_limit = (np.isclose(q + d, LOWER) | np.isclose(q + d, UPPER)).any()
    if np.linalg.svd(J, compute_uv=False)[-1] > 0.1 and not at_a_limit:
        tip = Rotation.from_rotvec(tilted).apply(correction.tip(q + d))
        assert np.linalg.norm(tip - correction.tip(q)) < 1e-4
        assert correction.error < 1e-4


def test_it_is_the_least_change():
    """Of all corrections that reach the same tip, none along the null space is smaller."""
    correction = Correction(AXES, 1e-4)
    q, base = np.array(HOME), exp(0.05, -0.1, 0.02)
    for _ in range(5):
        d = correction.solve(q, base).copy()
    J = np.array(Axes(AXES).forward((q + d).tolist())[1]).T
    weight = np.array([0.01 if a.slides else 1.0 for a in AXES])
    null = np.linalg.svd(J)[2][3:]
    np.testing.assert_allclose(null @ (d / weight), 0, atol=2e-3)


def test_joints_at_their_limits_leave_the_rest_to_the_others():
    q, base = np.array(HOME), exp(0.1, 0.1, 0.0)
    free = Correction(AXES, 0.005)
    tight = [axis.model_copy(update={"lower": v - 0.01, "upper": v + 0.01}) for axis, v in zip(AXES, q, strict=True)]
    some = Correction([*AXES[:3], *tight[3:]], 0.005)
    none = Correction(tight, 0.005)
    for _ in range(5):
        d = [c.solve(q, base).copy() for c in (free, some, none)]
    assert np.abs(d[0][3:]).max() > 0.011
    assert np.abs(d[1][3:]).max() <= 0.01 + 1e-12
    assert some.error < 0.004
    assert np.abs(d[2]).max() <= 0.01 + 1e-12
    assert none.error > 0.02


@pytest.mark.slow
def test_no_held_joint_would_rather_move_back():
    """Against an independent solver of bounded least squares, near the limits of the arm."""
    rng, held = np.random.default_rng(4), 0
    for _ in range(150):
        q = LOWER + rng.choice([0.0, 0.02, 0.5, 0.98, 1.0], 7) * (UPPER - LOWER)
        correction = Correction(AXES, 0.02)
        J = np.array(Axes(AXES).forward(q.tolist())[1]).T
        task, low, high = rng.normal(size=3) * 0.05, LOWER - q, UPPER - q
        weight = np.array([0.1 if a.slides else 1.0 for a in AXES])
        A, b = np.vstack([J / 0.02, np.diag(1 / weight)]), np.concatenate([task / 0.02, np.zeros(7)])
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        least = lsq_linear(A, b, (low - 1e-12, high + 1e-12), tol=1e-12).cost
        d = correction._bounded(J, task, low, high)
        assert ((d >= low - 1e-12) & (d <= high + 1e-12)).all()
        assert 0.5 * np.sum((A @ d - b) ** 2) <= least * (1 + 1e-6) + 1e-9
        held += bool(((d == low) | (d == high)).sum() > 1)
    assert held > 50


def test_near_a_singularity_the_correction_stays_small():
    straight = np.zeros(7)  # stretched, and J5 held: the tip can't come nearer nor go further
    axes = [a.model_copy(update={"lower": -1e-6, "upper": 1e-6}) if a.slides else a for a in AXES]
    assert np.linalg.svd(np.array(Axes(tuple(axes)).forward([0.0] * 7)[1])[[0, 1, 2, 3, 5, 6]])[1][-1] < 1e-6
    correction = Correction(axes, 0.02)
    for tilted in ((0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3), (0.2, 0.2, -0.1)):
        correction.reset()
        last = correction.d.copy()
        for k in range(101):
            d = correction.solve(straight, exp(*(0.01 * k * v for v in tilted))).copy()
            assert np.isfinite(d).all()
            assert np.abs(d - last).max() < 0.05, "no jump"
            last = d
        assert np.abs(d).max() < 1.2
