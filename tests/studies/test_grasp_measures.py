"""Grasp measures against cases that can be computed by hand, against each other, and against other methods."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from srl.runtime.contracts.rotation import from_rpy, matrix
from srl.runtime.contracts.signals import Array
from srl.studies.grasp.measures import (
    Contacts,
    epsilon,
    force_closure,
    grasp_matrix,
    isotropy,
    isotropy_of_moments,
    wrenches,
)
from srl.studies.grasp.things import SHAPES, SIZES, Thing

R = 0.05  # m
AXES = np.vstack([np.eye(3), -np.eye(3)])
OCTAHEDRON = Contacts(R * AXES, -AXES)
SEEDS = st.integers(0, 10_000)


def sphere(seed: int, k: int, lowest: float = -1.0) -> Contacts:
    """k random contacts of a sphere, none below a height from -1 to 1."""
    rng = np.random.default_rng(seed)
    z, turn = rng.uniform(lowest, 1.0, k), rng.uniform(0.0, 2 * np.pi, k)
    out = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return Contacts(R * out, -out)


def test_an_octahedron_is_isotropic_at_the_length_of_evenly_spread_contacts() -> None:
    assert isotropy(OCTAHEDRON.points, R) == pytest.approx(np.sqrt(2 / 3))
    assert isotropy(OCTAHEDRON.points, np.sqrt(2 / 3) * R) == pytest.approx(1.0)
    assert Thing("sphere", 2 * R).length == pytest.approx(np.sqrt(2 / 3) * R)


def test_three_contacts_at_120_degrees_have_the_known_singular_values() -> None:
    turn = 2 * np.pi * np.arange(3) / 3
    points = R * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    squares = np.linalg.svd(grasp_matrix(points, R), compute_uv=False) ** 2
    assert squares == pytest.approx([3.0, 3.0, 3.0, 3.0, 1.5, 1.5])


def test_in_millimetres_isotropy_falls_with_size_and_in_metres_it_rises() -> None:
    small, large = OCTAHEDRON.points, 2 * OCTAHEDRON.points
    assert isotropy(large, 0.001) == pytest.approx(isotropy(small, 0.001) / 2)
    assert isotropy(large, 1.0) == pytest.approx(2 * isotropy(small, 1.0))


@given(SEEDS, st.integers(1, 8))
def test_the_grasp_matrix_sums_forces_and_their_torques(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    points, forces = rng.normal(size=(k, 3)), rng.normal(size=(k, 3))
    wrench = grasp_matrix(points, 0.04) @ forces.ravel()
    assert wrench[:3] == pytest.approx(forces.sum(axis=0))
    assert wrench[3:] == pytest.approx(np.cross(points, forces).sum(axis=0) / 0.04)


@given(SEEDS, st.integers(0, 9))
def test_isotropy_depends_on_no_axes_and_no_order(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(k, 3))
    turned = points[rng.permutation(k)] @ matrix(from_rpy(*rng.uniform(-3, 3, 3))).T
    found = isotropy(points, 0.7)
    assert 0.0 <= found <= 1.0
    assert isotropy(turned, 0.7) == pytest.approx(found, abs=1e-7)
    if k < 3:  # two contacts leave the rotation about their line
        assert found == 0.0


def test_contacts_on_a_line_have_no_isotropy() -> None:
    assert isotropy(np.outer([0.0, 1.0, 2.0, 5.0], [0.3, -0.2, 0.9]), 0.5) == 0.0


@given(SEEDS, st.integers(3, 9))
def test_the_moments_give_the_same_isotropy(seed: int, k: int) -> None:
    points = np.random.default_rng(seed).normal(size=(4, k, 3))
    found = isotropy_of_moments(k, points.sum(axis=1), np.einsum("mki,mkj->mij", points, points), 0.8)
    assert found == pytest.approx([isotropy(p, 0.8) for p in points], abs=1e-6)


@pytest.mark.parametrize(("edges", "expected"), [(4, 0.462), (8, 0.653), (16, 0.653)])
def test_epsilon_of_an_octahedron(edges: int, expected: float) -> None:
    assert epsilon(wrenches(OCTAHEDRON, 0.8, R, edges)) == pytest.approx(expected, abs=5e-4)


@pytest.mark.slow
@given(SEEDS, st.integers(1, 9), st.sampled_from([-1.0, 0.0, 0.6]))
@settings(max_examples=40, deadline=None)
def test_closure_by_a_linear_program_agrees_with_the_hull(seed: int, k: int, lowest: float) -> None:
    W = wrenches(sphere(seed, k, lowest), 0.5, R)
    found = epsilon(W)
    if found == 0.0 or found > 1e-6:  # between them rounding decides
        assert force_closure(W) is (found > 0.0)


@pytest.mark.slow
@given(SEEDS, st.integers(4, 7))
@settings(max_examples=20, deadline=None)
def test_no_direction_is_resisted_less_than_epsilon(seed: int, k: int) -> None:
    """A linear program finds how far the hull goes along a direction: never less than epsilon."""
    W = wrenches(sphere(seed, k), 0.8, R)
    found, rng = epsilon(W), np.random.default_rng(seed)
    if not found:
        return
    for direction in rng.normal(size=(5, 6)):
        u = direction / np.linalg.norm(direction)
        # W^T s = t u, shares s >= 0 with sum 1; the largest t
        equal = np.vstack([np.column_stack([W.T, -u]), np.append(np.ones(len(W)), 0.0)])
        ray = linprog(np.append(np.zeros(len(W)), -1.0), A_eq=equal, b_eq=[0.0] * 6 + [1.0])
        assert ray.fun is not None
        assert -ray.fun >= found - 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_some_direction_is_resisted_no_more_than_epsilon(seed: int) -> None:
    """Epsilon is the least support of the hull, found by another optimiser from many starts."""
    W = wrenches(sphere(seed, 6), 0.8, R)

    def least(start: Array) -> float:
        start = start / np.linalg.norm(start)
        norm = {"type": "eq", "fun": lambda x: x[:6] @ x[:6] - 1.0}
        below = {"type": "ineq", "fun": lambda x: x[6] - W @ x[:6]}
        first = np.append(start, (W @ start).max())
        done: Any = minimize(lambda x: float(x[6]), first, constraints=[norm, below], method="SLSQP")  # type: ignore[call-overload]
        return float(done.x[6]) if done.success else np.inf

    starts = np.random.default_rng(seed).normal(size=(40, 6))
    assert min(map(least, starts)) == pytest.approx(epsilon(W), rel=1e-4)


def test_two_contacts_never_close_and_a_cap_is_isotropic_without_closing() -> None:
    pair = Contacts(np.array([[R, 0, 0], [-R, 0, 0]]), np.array([[-1.0, 0, 0], [1.0, 0, 0]]))
    assert not force_closure(wrenches(pair, 0.8, R))
    turn = 2 * np.pi * np.arange(5) / 5
    cap = np.radians(50)
    out = np.column_stack([np.sin(cap) * np.cos(turn), np.sin(cap) * np.sin(turn), np.full(5, np.cos(cap))])
    W = wrenches(Contacts(R * out, -out), 0.8, R)
    assert isotropy(R * out, np.sqrt(2 / 3) * R) > 0.3
    assert not force_closure(W)
    assert epsilon(W) == 0.0


@pytest.mark.slow
@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_epsilon_grows_with_contacts_and_with_friction(seed: int) -> None:
    few, more = sphere(seed, 4), sphere(seed + 1, 2)
    base = epsilon(wrenches(few, 0.5, R))
    assert epsilon(wrenches(few.joined(more), 0.5, R)) >= base - 1e-9
    assert epsilon(wrenches(few, 0.8, R)) >= base - 1e-9


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [SIZES[0], SIZES[-1]])
def test_random_contacts_lie_evenly_on_the_surface(shape: str, size: float) -> None:
    thing = Thing(shape, size)  # type: ignore[arg-type]
    drawn = thing.surface(np.random.default_rng(5), 20_000)
    p, n = drawn.points, drawn.normals
    assert np.sqrt((p**2).sum(axis=1).mean()) == pytest.approx(thing.rms_radius, rel=0.01)
    assert np.abs(p.mean(axis=0)).max() < 0.02 * size
    assert np.linalg.norm(n, axis=1) == pytest.approx(np.ones(len(n)))
    # A step along the normal goes inside, a step against it outside: the surface has no thickness.
    assert inside(thing, p + 1e-6 * n).all()
    assert not inside(thing, p - 1e-6 * n).any()


def inside(thing: Thing, p: Array) -> Array:
    half = thing.size / 2
    if thing.shape == "sphere":
        return np.asarray(np.linalg.norm(p, axis=1) < half)
    if thing.shape == "cube":
        return np.asarray((np.abs(p) < half).all(axis=1))
    length = thing.part(np.zeros(3), (1.0, 0.0, 0.0, 0.0))["size"][1]
    return np.asarray((np.hypot(p[:, 0], p[:, 1]) < half) & (np.abs(p[:, 2]) < length / 2))
