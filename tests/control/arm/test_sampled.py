"""Whether late torques damp: against a bound by hand, and against the motion itself, stepped finely."""

from __future__ import annotations

import numpy as np
import pytest

from srl.control.arm.sampled import growth


@pytest.mark.parametrize(("share", "grows"), [(0.5, False), (0.98, False), (1.02, True), (2.0, True)])
def test_a_damper_alone_may_take_a_whole_velocity_in_a_cycle(share: float, grows: bool) -> None:
    """v' = v + T/M tau, tau' = -D v: z^2 - z + D T/M = 0, whose roots are within the unit circle for D T/M < 1."""
    M, dt = 0.05, 0.004
    found = growth(np.array([[M]]), np.zeros((1, 1)), np.array([1e-9]), np.array([share * M / dt]), dt)
    assert (found > 1e-3) == grows


@pytest.mark.parametrize(("dt", "stiff"), [(0.002, 0.0), (0.004, 300.0), (0.008, 1000.0)])
def test_it_says_how_the_motion_grows(dt: float, stiff: float) -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(3, 3))
    M = 0.02 * A @ A.T + 0.02 * np.eye(3)
    way = rng.normal(size=3)
    C, K = stiff * np.outer(way, way), 20.0 * rng.uniform(0.5, 1.5, 3)
    D = 1.4 * np.sqrt(K * M.diagonal())
    inverse, steps = np.linalg.inv(M), 40
    h = dt / steps
    q, v, torque = rng.normal(size=3), np.zeros(3), np.zeros(3)
    grown = []
    for _ in range(120):
        following = -K * q - D * v  # acts from the next cycle on
        for _ in range(steps):
            v = v + h * inverse @ (torque - C @ q)
            q = q + h * v
        size = np.sqrt(v @ M @ v + q @ (C + np.diag(K)) @ q)
        grown.append(np.log(size))
        q, v, torque = q / size, v / size, following / size
    assert np.mean(grown[60:]) == pytest.approx(growth(M, C, K, D, dt) * dt, abs=0.02)
