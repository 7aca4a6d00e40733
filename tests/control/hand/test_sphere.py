"""The least sphere against a search over all spheres through two, three and four points."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from srl.control.hand.sphere import MinimumSphere
from srl.runtime.contracts.signals import Array


def brute_force(points: Array) -> float:
    """The radius of the smallest circumsphere of up to four points that holds them all."""
    best = np.inf
    for size in range(1, min(len(points), 4) + 1):
        for chosen in combinations(points, size):
            p = np.array(chosen)
            edges = p[1:] - p[0]
            centre = p[0]
            if size > 1:  # least norm: the centre lies in the points' affine hull
                centre = p[0] + np.linalg.lstsq(2 * edges, (edges * edges).sum(axis=1), rcond=1e-12)[0]
            r = np.linalg.norm(points - centre, axis=1).max()
            best = min(best, r)
    return best


def check(points: Array, tolerance: float = 1e-9) -> None:
    x, y, z, r = MinimumSphere().around(points.tolist())
    d = np.linalg.norm(points - [x, y, z], axis=1)
    assert d.max() <= r * (1 + 1e-9)
    if len(points) > 1:
        assert np.sum(d >= r * (1 - 1e-9)) >= 2 or r == 0.0
    assert r == pytest.approx(brute_force(points), rel=tolerance, abs=1e-12)


@pytest.mark.slow
def test_many_random_sets() -> None:
    rng = np.random.default_rng(1)
    for _ in range(1200):
        check(rng.normal(size=(rng.integers(1, 7), 3)) * rng.choice([1e-3, 0.1, 10.0]))


def test_flat_straight_and_coincident_sets() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        rank = rng.integers(0, 3)
        n = rng.integers(2, 8)
        points = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, 3)) + rng.normal(size=3)
        points = np.concatenate([points, points[: rng.integers(0, 3)]])
        check(points, 1e-7)


@given(arrays(float, st.tuples(st.integers(1, 7), st.just(3)), elements=st.integers(-2, 2).map(float)))
@settings(max_examples=150)
def test_lattice_points_with_many_ties(points: Array) -> None:
    check(points)


def test_fingertips_a_hair_from_a_line() -> None:
    for bend in 10.0 ** np.arange(-14, -1):
        points = np.array([[-1.0, 0, 0], [0.2, bend, 0], [1.0, 0, bend], [0.9, -bend, 0]]) * 0.03
        check(points, 1e-7)


def test_a_regular_tetrahedron_needs_all_four() -> None:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) + 5.0
    np.testing.assert_allclose(MinimumSphere().around(corners.tolist()), [5, 5, 5, np.sqrt(3)], rtol=1e-12)


def test_order_does_not_matter_and_runs_repeat() -> None:
    points = np.random.default_rng(3).normal(size=(6, 3))
    sphere = MinimumSphere().around(points.tolist())
    assert MinimumSphere().around(points.copy().tolist()) == sphere
    np.testing.assert_allclose(MinimumSphere().around(points[::-1].tolist()), sphere, rtol=1e-9)


def test_points_that_move_on_have_the_same_sphere_as_afresh() -> None:
    """The support of the last call is tried; it changes on the way, and points may coincide or jump."""
    rng, moving = np.random.default_rng(4), MinimumSphere()
    points, kept, supports = rng.normal(size=(6, 3)), 0, []
    for k in range(1500):
        points = points + rng.choice([0.0, 1e-6, 0.02, 0.5], p=[0.1, 0.3, 0.58, 0.02]) * rng.normal(size=(6, 3))
        if k % 100 == 0:
            points[1] = points[0]
        found = moving.around(points.tolist())
        np.testing.assert_allclose(found, MinimumSphere().around(points.tolist()), rtol=0, atol=1e-8 * found[3])
        supports.append(list(moving.support))
        kept += k > 0 and supports[-1] == supports[-2]
    assert 500 < kept < 1499
    assert {len(s) for s in supports} == {2, 3, 4}


def test_reset_forgets_the_support() -> None:
    used, fresh = MinimumSphere(), MinimumSphere()
    used.around([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.1, 0.2, 0.0]])
    used.reset()
    cloud = [[0.0, 0.0, 0.0], [0.2, 0.9, 0.1], [1.0, 0.0, 0.0]]
    assert used.around(cloud) == fresh.around(cloud)
