"""Identification of a load: against Pinocchio's rigid body, its bounds, and how sure it says to be."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.cobot.load_estimate import LoadEstimate, Motion
from srl.runtime.contracts.signals import Array

DOWN = np.array([0.0, 0.0, -9.81])


def body(mass: float, com: Array, inertia: Array, turn: Rotation, a: Array, w: Array, z: Array) -> tuple[Array, Motion]:
    """The wrench (6,) of a rigid body on what holds it, by Pinocchio's Newton and Euler, and the motion.

    `a` is the acceleration of the tool's origin in world axes, `w` and `z` are the angular ones in the tool's.
    """
    g = turn.inv().apply(DOWN - a)
    rigid = pin.Inertia(mass, com, inertia)
    # At rest in space but for the turning: the spatial acceleration of the origin is what the load is given.
    moved = rigid * pin.Motion(-g, z) + pin.Motion(np.zeros(3), w).cross(rigid * pin.Motion(np.zeros(3), w))
    return -moved.vector, Motion(tuple(g), tuple(w), tuple(z))


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_a_loads_wrench_is_that_of_pinocchios_rigid_body_without_inertia_about_its_middle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mass, com = rng.uniform(0.5, 15), rng.uniform(-0.25, 0.25, 3)
    turn = Rotation.random(random_state=rng)
    true, at = body(mass, com, np.zeros((3, 3)), turn, *rng.normal(0, 2, (3, 3)))
    estimate = LoadEstimate(16.0, 0.5, (2.0, 0.2))
    estimate.take(mass, tuple(mass * com))
    np.testing.assert_allclose(estimate.wrench(at), true, atol=1e-9)
    np.testing.assert_allclose(estimate._fill(at) @ [mass, *(mass * com)], true, atol=1e-9)


@pytest.mark.parametrize("inertia", [0.0, 0.08])
def test_mass_and_centre_are_found_from_gravity_in_some_postures_and_from_guided_motion(inertia: float) -> None:
    """`inertia` about the middle, kg m^2: a box of 10 kg with sides of 0.2 and 0.3 m has up to 0.11."""
    rng = np.random.default_rng(3)
    mass, com = 10.0, np.array([0.05, -0.02, 0.3])
    estimate = LoadEstimate(16.0, 0.5, (2.0, 0.2))
    for k in range(600):
        t = k * 20e-3
        turn = Rotation.from_euler("xyz", [0.3 * np.sin(t), 0.2 * np.sin(1.3 * t), 0.1 * t])
        motion = rng.normal(0, 0.5, 3), rng.normal(0, 0.3, 3), rng.normal(0, 0.7, 3)
        true, at = body(mass, com, inertia * np.eye(3), turn, *motion)
        estimate.update(true.tolist(), at, 20e-3)
    assert estimate.mass == pytest.approx(mass, abs=0.01)
    np.testing.assert_allclose(estimate.com, com, atol=0.003)
    assert estimate.deviations()[0] < 0.05


def test_the_centre_along_gravity_stays_unknown_until_the_tool_is_turned() -> None:
    mass, com = 4.0, np.array([0.03, 0.01, 0.2])
    estimate = LoadEstimate(16.0, 0.5, (2.0, 0.2))
    still = np.zeros(3)

    def hold(turn: Rotation) -> None:
        for _ in range(500):
            true, at = body(mass, com, np.zeros((3, 3)), turn, still, still, still)
            estimate.update(true.tolist(), at, 8e-3)

    hold(Rotation.identity())
    _, dx, dy, dz = estimate.deviations()
    assert max(dx, dy) < 0.01 < 0.3 < dz
    hold(Rotation.from_euler("y", 0.4))
    assert estimate.deviations()[3] < 0.05
    np.testing.assert_allclose(estimate.com, com, atol=0.01)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_the_load_stays_within_what_can_be(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate = LoadEstimate(3.0, 0.2, (2.0, 0.2))
    for _ in range(25):
        turn = Rotation.random(random_state=rng)
        _, at = body(1.0, np.zeros(3), np.eye(3), turn, *rng.normal(0, 2, (3, 3)))
        wrench = rng.normal(0, [80, 80, 80, 20, 20, 20]).tolist()
        estimate.update(wrench, at, 8e-3, bandwidth=rng.uniform(0, 30))
        for m, h in ((estimate.mass, estimate.moment), estimate.glance(wrench, at)):
            assert 0.0 <= m <= 3.0
            assert np.linalg.norm(h) <= 0.2 * m + 1e-9
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0


def test_the_deviation_is_as_large_as_the_errors_are() -> None:
    """Errors that last 0.05 s, as the estimate assumes: 100 runs of two seconds, mass within the stated deviation."""
    rng = np.random.default_rng(1)
    at = Motion(tuple(DOWN), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    off = []
    for _ in range(100):
        estimate = LoadEstimate(16.0, 0.5, (2.0, 0.2))
        for _ in range(40):
            wrench = np.array([0, 0, -49.05, 0, 0, 0]) + rng.normal(0, [2, 2, 2, 0.2, 0.2, 0.2])
            estimate.update(wrench.tolist(), at, 0.05)
        off.append((estimate.mass - 5.0) / estimate.deviations()[0])
    assert 0.8 < np.std(off) < 1.2
    assert abs(np.mean(off)) < 0.35


def test_it_follows_a_load_that_comes_in_and_then_holds_it() -> None:
    estimate = LoadEstimate(16.0, 0.5, (2.0, 0.2))
    at = Motion(tuple(DOWN), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(100):
        estimate.update([0, 0, -98.1 * min(k / 50, 1.0), 0, 0, 0], at, 8e-3, bandwidth=20.0)
    assert estimate.mass == pytest.approx(10.0, abs=0.1)
    for _ in range(2500):
        estimate.update([0, 0, -98.1, 0, 0, 0], at, 8e-3)
    for _ in range(100):
        estimate.update([0, 0, -110.0, 0, 0, 0], at, 8e-3)  # 0.8 s of leaning
    assert estimate.mass == pytest.approx(10.0, abs=0.1)
