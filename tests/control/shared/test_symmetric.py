"""Symmetric 3 x 3 matrices in plain numbers against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.shared.symmetric import (
    FIRM,
    Symmetric,
    eigen,
    gram,
    inverse,
    is_above,
    mean,
    products,
    raised_inverse,
    times,
)
from srl.runtime.contracts.signals import Array


def full(M: Symmetric) -> Array:
    xx, xy, xz, yy, yz, zz = M
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def symmetric(lam: Array, turn: Array) -> tuple[Symmetric, Array]:
    U = Rotation.from_rotvec(turn).as_matrix()
    M = U @ np.diag(lam) @ U.T
    return tuple(M[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].tolist()), U


eigenvalues = st.lists(st.floats(-8, 0).map(lambda x: 10.0**x), min_size=3, max_size=3).map(np.array)
turns = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(eigenvalues, turns, st.floats(-7, -1).map(lambda x: 10.0**x))
def test_eigenvalues_below_the_floor_are_raised_on_both_ways(lam: Array, turn: Array, floor: float) -> None:
    """Closed form where the matrix is well conditioned and above the floor, eigenvectors elsewhere."""
    M, U = symmetric(lam, turn)
    expected = (U / np.maximum(lam, floor)) @ U.T
    np.testing.assert_allclose(full(raised_inverse(M, floor)), expected, atol=1e-8 * np.abs(expected).max())
    if min(lam) > FIRM * sum(lam) * 1.001:
        np.testing.assert_allclose(full(inverse(M)), np.linalg.inv(full(M)), atol=1e-9 / min(lam))


@given(eigenvalues, turns, st.sampled_from([1e-100, 1.0, 1e100]))
def test_eigenvalues_and_vectors(lam: Array, turn: Array, scale: float) -> None:
    M, _ = symmetric(scale * lam, turn)
    found, rows = zip(*eigen(M), strict=True)
    U = np.array(rows)
    np.testing.assert_allclose(sorted(found), np.linalg.eigvalsh(full(M)), rtol=0, atol=1e-15 * max(found))
    np.testing.assert_allclose(U @ U.T, np.eye(3), atol=5e-15)
    np.testing.assert_allclose(U.T @ np.diag(found) @ U, full(M), rtol=0, atol=5e-15 * max(found))


@given(eigenvalues, turns, st.floats(-1, 1))
def test_above_is_decided_by_the_least_eigenvalue(lam: Array, turn: Array, floor: float) -> None:
    M, _ = symmetric(lam, turn)
    if abs(min(lam) - floor) > 1e-12:
        assert is_above(M, floor) == (min(lam) > floor)


def test_products() -> None:
    vectors = np.random.default_rng(1).normal(size=(5, 3))
    M = gram(vectors.tolist())
    np.testing.assert_allclose(full(M), vectors.T @ vectors)
    others = np.random.default_rng(2).normal(size=(5, 3))
    np.testing.assert_allclose(products(vectors.tolist(), others.tolist()), vectors.T @ others)
    np.testing.assert_allclose(mean(vectors.tolist()), vectors.mean(axis=0))
    assert times(M, (1.0, -2.0, 0.5)) == pytest.approx(full(M) @ [1.0, -2.0, 0.5])


def test_a_singular_matrix_whose_shifted_minor_is_rounding_isnt_firm() -> None:
    """Of a straight thumb at its limit: the eigenvalues are 0, 1e-4 but for rounding, and 3e-3."""
    M = (
        *(0.0022117485200598887, 0.0012192185765173712, -0.0006765823467065929),
        *(0.000803916173353297, -0.00039062500000000035, 0.0002093353065868148),
    )
    assert not is_above(M, 1e-4)
    inverse = full(raised_inverse(M, 1e-4))
    assert np.linalg.eigvalsh(inverse).max() == pytest.approx(1e4, rel=1e-6)
