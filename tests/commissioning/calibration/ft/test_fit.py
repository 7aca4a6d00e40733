"""A sensor's bias and load from poses: exact without noise, as uncertain as stated with it, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.commissioning.calibration.ft.fit import FtError, Load, Thresholds, fit, refusals
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Array

BIAS = np.array([30.0, -20.0, 10.0, 1.0, 2.0, -3.0])
MASS, COM = 0.45, np.array([0.004, -0.007, 0.053])
SIGMA = np.array([0.01] * 3 + [0.0003] * 3)
UPS = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 1, 1], [1, 1, -1]], float)


def shown(ups: Array = UPS, bias: Array = BIAS, mass: float = MASS, com: Array = COM) -> Array:
    """(n, 6): what the sensor shows with these directions of its own up."""
    weight = -mass * GRAVITY * ups / np.linalg.norm(ups, axis=1)[:, None]
    return np.hstack([weight, np.cross(com, weight)]) + bias


def found(wrench: Array, noise: Array = SIGMA, thresholds: Thresholds | None = None) -> Load:
    return fit(range(1, len(wrench) + 1), wrench, noise, thresholds or Thresholds())


@settings(deadline=None, max_examples=50)
@given(
    st.tuples(*[st.floats(-100, 100)] * 6), st.floats(0.1, 5.0), st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    st.integers(0, 1000),
)  # fmt: skip
def test_without_noise_it_is_exact(bias: tuple[float, ...], mass: float, com: tuple[float, ...], seed: int) -> None:
    ups = UPS + np.random.default_rng(seed).normal(0.0, 0.1, UPS.shape)
    load = found(shown(ups, np.array(bias), mass, np.array(com)))
    np.testing.assert_allclose(load.bias, bias, atol=1e-6)
    assert load.mass == pytest.approx(mass, abs=1e-6)
    np.testing.assert_allclose(load.com, com, atol=1e-6)
    up = ups / np.linalg.norm(ups, axis=1)[:, None]
    np.testing.assert_allclose(load.down, -up, atol=1e-6)
    assert max(load.most) < 1e-6


def test_the_stated_uncertainty_is_that_of_many_repetitions() -> None:
    random = np.random.default_rng(1)
    loads = [found(shown() + SIGMA * random.normal(size=(8, 6)), 0.0 * SIGMA) for _ in range(300)]
    errors = [
        (
            np.linalg.norm(each.bias[:3] - BIAS[:3]), np.linalg.norm(each.bias[3:] - BIAS[3:]),
            abs(each.mass - MASS), np.linalg.norm(each.com - COM),
        )
        for each in loads
    ]  # fmt: skip
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square([e.uncertain for e in loads]), axis=0))
    assert (ratio > 0.7).all()
    assert (ratio < 1.15).all()


def test_too_few_poses_two_alike_and_poses_in_a_plane_are_refused() -> None:
    with pytest.raises(FtError, match="poses: 5 are held, 6 are needed"):
        found(shown(UPS[:5]))
    with pytest.raises(FtError, match=r"pose 7: it is like pose 1: their forces differ by 0\.00 N"):
        found(shown(UPS[[0, 1, 2, 3, 4, 5, 0]]))
    angles = np.linspace(0.0, 6.0, 8)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.full(8, 0.1)])
    with pytest.raises(FtError, match="poses: they lie too near one plane"):
        found(shown(ring))
    with pytest.raises(FtError, match="with a tool too light to be weighed"):
        found(shown(mass=0.005))


def test_a_pose_that_somebody_touched_is_named() -> None:
    wrench = shown()
    wrench[3, :3] += 1.5
    refused = refusals(found(wrench), Thresholds())
    assert "pose 4" in [r.place for r in refused]
    assert refusals(found(shown()), Thresholds()) == ()


def test_noise_that_hides_the_bias_is_refused() -> None:
    (force, torque) = refusals(found(shown(), np.full(6, 1.0)), Thresholds())
    assert "the force's bias is uncertain by" in force.problem
    assert "the torque's bias is uncertain by" in torque.problem
