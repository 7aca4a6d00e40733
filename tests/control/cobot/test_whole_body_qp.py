"""The program with two priorities against a dense solver of another kind, and the braking curves against motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from srl.control.cobot.whole_body_qp import Approach, LimitsConfig, Nearest, intervals, turned_base
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA, UR16E

seeds = st.integers(0, 2**32 - 1)


def dense(H: Array, g: Array, G: Array, h: Array) -> Array:
    """min x' H x / 2 + g' x with G x >= h, as least distance programming (Lawson and Hanson, chapter 23)."""
    L = np.linalg.cholesky(H)
    rows = np.linalg.solve(L, G.T).T
    least = h + rows @ np.linalg.solve(L, g)
    size = np.linalg.norm(rows, axis=1)
    rows, least = rows / size[:, None], least / size
    unit = max(1.0, np.abs(least).max())
    E = np.vstack([rows.T, least / unit])
    u, _ = nnls(E, np.eye(len(E))[-1], maxiter=2000)
    r = E @ u - np.eye(len(E))[-1]
    return np.linalg.solve(L.T, -unit * r[:-1] / r[-1] - np.linalg.solve(L, g))


def strict(A: Array, Q: Array, W: Array, b: Array, x0: Array, G: Array, h: Array) -> tuple[float, Array]:
    """The two levels one after the other: least |A x - b|_Q within G x >= h, and of those the least |x - x0|_W.

    The second level may leave the first's optimum by a rounding.
    """
    D = 1 / np.sqrt(W.diagonal())
    As, Gs, Ws = np.sqrt(Q)[:, None] * A * D, G * D, W * D * D[:, None]
    bs, z0 = np.sqrt(Q) * b, x0 / D
    size = float((As.T @ As).diagonal().max())
    z = dense(As.T @ As / size + 1e-11 * Ws, -As.T @ bs / size - 1e-11 * Ws @ z0, Gs, h)
    least = float(np.sum((As @ z - bs) ** 2))
    rows, loose = np.vstack([As, -As]), 1e-7 * np.sqrt(size)
    held = np.concatenate([As @ z, -As @ z]) - loose
    z = dense(Ws, -Ws @ z0, np.vstack([Gs, rows]), np.concatenate([h, held]))
    return least, D * z


def problem(seed: int, m: int, r: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """A, Q, W, rows and limits that a point keeps."""
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(6, m)), rng.normal(size=(r, m))
    B = rng.normal(size=(m, m))
    scale = 10 ** rng.uniform(-1, 1, m)
    W = (B @ B.T / m + np.eye(m)) * scale * scale[:, None]
    inside = rng.normal(0, 1, m)
    at = np.concatenate([inside, C @ inside])
    return A, rng.uniform(0.1, 1, 6), W, C, at - rng.exponential(0.5, m + r), at + rng.exponential(0.5, m + r)


def test_wide_limits_change_nothing() -> None:
    A, Q, W, C, _, _ = problem(1, 10, 7)
    for priority in (1.0, 1e4, 1e8):
        away = Nearest(priority)(A, Q, W, np.full(17, -np.inf), np.full(17, np.inf), C)
        assert away is not None
        np.testing.assert_allclose(away, 0, atol=1e-9)


@settings(max_examples=150, deadline=None)
@given(seeds, st.sampled_from([(10, 7), (9, 0), (10, 0), (9, 6)]))
def test_it_keeps_limits_and_misses_no_more_of_the_task_than_must_be(seed: int, size: tuple[int, int]) -> None:
    m, r = size
    A, Q, W, C, lower, upper = problem(seed, m, r)
    x = Nearest(1e8)(A, Q, W, lower, upper, C)
    assert x is not None
    G = np.vstack([np.eye(m), C])
    assert (G @ x >= lower - 1e-7).all()
    assert (G @ x <= upper + 1e-7).all()
    least, best = strict(A, Q, W, np.zeros(6), np.zeros(m), np.vstack([G, -G]), np.concatenate([lower, -upper]))
    cost = float(best @ W @ best)
    assert np.sum(Q * (A @ x) ** 2) <= least + 1e-6 * (1 + cost)
    assert x @ W @ x <= 1.01 * cost + 1e-6


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_the_nearest_point_to_the_laws_own_solves_the_programs_it_came_from(seed: int) -> None:
    """First least |A x - b|, then least |x - x_p|: the same as first least |A (x - x_0)|, then least |x - x_0|, with
    x_0 the solution without limits."""
    A, Q, W, C, lower, upper = problem(seed, 10, 7)
    rng = np.random.default_rng(seed + 1)
    b, preferred = rng.normal(0, 3, 6), rng.normal(0, 1, 10)
    Wi = np.linalg.inv(W)
    x0 = preferred + Wi @ A.T @ np.linalg.solve(A @ Wi @ A.T, b - A @ preferred)
    G = np.vstack([np.eye(10), C])
    at = G @ x0
    away = Nearest(1e8)(A, Q, W, lower - at, upper - at, C)
    assert away is not None
    x = x0 + away
    least, best = strict(A, Q, W, b, preferred, np.vstack([G, -G]), np.concatenate([lower, -upper]))
    cost = float((best - preferred) @ W @ (best - preferred))
    assert np.sum(Q * (A @ x - b) ** 2) <= least + 1e-6 * (1 + cost)
    assert (x - preferred) @ W @ (x - preferred) <= 1.01 * cost + 1e-6


@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(0, 6).map(lambda e: 10**e))
def test_what_a_lower_priority_gives_away_is_bounded(seed: int, priority: float) -> None:
    """Missed more than the least by the weights' cost over the priority at most, both scaled to one."""
    A, Q, W, C, lower, upper = problem(seed, 10, 7)
    x = Nearest(priority)(A, Q, W, lower, upper, C)
    assert x is not None
    G = np.vstack([np.eye(10), C])
    least, best = strict(A, Q, W, np.zeros(6), np.zeros(10), np.vstack([G, -G]), np.concatenate([lower, -upper]))
    As = np.sqrt(Q)[:, None] * A / np.sqrt(W.diagonal())
    size = float((As * As).sum(axis=0).max())
    bound = size / priority * float(best @ W @ best - x @ W @ x)
    assert np.sum(Q * (A @ x) ** 2) - least <= bound + 1e-6 * (1 + least)


@pytest.mark.slow
def test_moving_limits_move_the_point_gradually() -> None:
    """Limits that come in: in steps of a quarter the point moves by a quarter, too; a jump would stay as it is."""
    for seed in range(4):
        A, Q, W, C, lower, upper = problem(seed, 10, 7)
        point = np.linalg.lstsq(np.vstack([np.eye(10), C]), 0.5 * (lower + upper), rcond=None)[0]
        kept = np.concatenate([point, C @ point])  # a point that stays inside
        lower, upper = np.minimum(lower, kept - 0.3), np.maximum(upper, kept + 0.3)
        largest = []
        for count in (500, 2000):
            found = [
                Nearest(1e4)(A, Q, W, kept + k * (lower - kept), kept + k * (upper - kept), C)
                for k in np.linspace(3, 0.1, count)
            ]
            largest.append(np.abs(np.diff(np.array(found), axis=0)).max())
        assert largest[1] < 0.35 * largest[0]


def test_limits_that_contradict_each_other_and_nonsense_are_told() -> None:
    A, Q, W, C, lower, upper = problem(3, 10, 7)
    nearest = Nearest(1e4)
    assert nearest(A, Q, W, upper + 1, lower - 1, C) is None
    assert nearest(A * np.nan, Q, W, lower, upper, C) is None
    assert nearest.failures == 2


def test_the_base_turns_its_columns() -> None:
    J = np.random.default_rng(0).normal(size=(6, 10))
    c, s = np.cos(0.7), np.sin(0.7)
    twist = np.array([0.3, -0.2, 0.5])
    world = np.array([c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]])
    turned = turned_base(J, c, s)
    np.testing.assert_allclose(turned[:, :3] @ twist, J[:, :3] @ world, atol=1e-12)
    np.testing.assert_array_equal(turned[:, 2:], J[:, 2:])


# -- the approach to limits


def test_an_interval_is_never_empty_and_within_reach() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        ends = np.sort(rng.normal(0, 2, (2, 6)), axis=0)
        before, step = rng.normal(0, 2, 6), rng.uniform(0, 1, 6)
        lower, upper = intervals(ends[0], ends[1], before, step)
        assert (lower <= upper).all()
        assert (np.abs(lower - before) <= step + 1e-12).all()
        assert (np.abs(upper - before) <= step + 1e-12).all()


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(seeds, st.sampled_from([0.001, 0.002, 0.01]), st.sampled_from([0.02, 0.05, 0.2]), st.booleans())
def test_greedy_accelerations_keep_all_limits(seed: int, dt: float, approach: float, panda: bool) -> None:
    """All the acceleration allowed, to and fro and held: position, speed and acceleration stay within."""
    robot = PANDA if panda else UR16E
    rng = np.random.default_rng(seed)
    curves = Approach(robot, LimitsConfig(approach=approach), 1.0)
    q, qd = np.array(robot.home), np.zeros(robot.n)
    target = rng.choice([-1.0, 1.0], robot.n)
    most, speed = curves.acceleration, robot.dq_max
    for _ in range(int(4 / dt)):
        if rng.random() < dt / 2:
            target = rng.choice([-1.0, 0.3, 1.0], robot.n)
        least, greatest = curves.accelerations(q, qd, dt)
        assert (least <= greatest).all()
        a = np.where(target > 0, target * greatest, -target * least)
        a = np.minimum(np.maximum(a, least), greatest)
        assert (np.abs(a) <= most + 1e-9).all()
        q, qd = q + dt * qd + dt * dt / 2 * a, qd + dt * a
        assert (np.abs(qd) <= speed + 1e-9).all()
        assert (q <= robot.q_upper).all()
        assert (q >= robot.q_lower).all()


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seeds, st.sampled_from([0.002, 0.008, 0.02]), st.booleans())
def test_greedy_velocities_keep_all_limits(seed: int, dt: float, panda: bool) -> None:
    robot = PANDA if panda else UR16E
    rng = np.random.default_rng(seed)
    curves = Approach(robot, LimitsConfig(), 1.0)
    q, v = np.array(robot.home), np.zeros(robot.n)
    target = rng.choice([-1.0, 1.0], robot.n)
    for _ in range(int(5 / dt)):
        if rng.random() < dt / 2:
            target = rng.choice([-1.0, 0.3, 1.0], robot.n)
        least, greatest = curves.speeds(q, v, dt)
        assert (least <= greatest).all()
        wanted = np.minimum(np.maximum(5 * target, least), greatest)
        assert (np.abs(wanted - v) <= curves.acceleration * dt + 1e-12).all()
        assert (np.abs(wanted) <= robot.dq_max + 1e-9).all()
        v = wanted
        q = q + dt * v
        assert (q <= robot.q_upper).all()
        assert (q >= robot.q_lower).all()


def test_bounds_on_the_acceleration_come_in_without_a_step() -> None:
    """From rest with all of it to the limit: what is allowed changes by no more than a few rates' worth a cycle."""
    curves, dt = Approach(PANDA, LimitsConfig(), 1.0), 1e-3
    q, qd, last = np.array(PANDA.home), np.zeros(7), curves.acceleration
    for _ in range(4000):
        _, greatest = curves.accelerations(q, qd, dt)
        assert (np.abs(greatest - last) <= 4 * curves.rate(dt) * curves.acceleration * dt).all()
        q, qd, last = q + dt * qd + dt * dt / 2 * greatest, qd + dt * greatest, greatest
    np.testing.assert_allclose(q, PANDA.q_upper - LimitsConfig().margin, atol=1e-3)


@pytest.mark.parametrize("beyond", [0.01, 0.3])
def test_from_beyond_a_limit_only_the_way_back_is_open(beyond: float) -> None:
    curves, dt = Approach(PANDA, LimitsConfig(), 1.0), 1e-3
    q, qd = PANDA.q_upper + beyond, np.zeros(7)
    for _ in range(3000):
        _, greatest = curves.accelerations(q, qd, dt)
        q, qd = q + dt * qd, qd + dt * greatest
        assert (qd <= 1e-9).all()
    assert (q <= PANDA.q_upper).all()


def test_limits_nearer_than_the_margins_leave_one_choice() -> None:
    narrow = replace(PANDA, q_upper=PANDA.home + 0.005, q_lower=PANDA.home - 0.005)
    least, greatest = Approach(narrow, LimitsConfig(), 1.0).accelerations(PANDA.home, np.zeros(7), 1e-3)
    np.testing.assert_allclose(least, greatest)
