"""Distances of capsules, the arm's kinematics for many configurations and reaches, against independent oracles."""

from __future__ import annotations

import tracemalloc
from typing import Any

import coal
import mujoco
import numpy as np
import pytest
from helpers.skeleton import THREE, TWO, human_srl
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from srl.control.skeleton.capsules import Nearest, between, nearest
from srl.control.skeleton.envelope import link_nodes, reaches
from srl.control.skeleton.kinematics import Kinematics

seeds = st.integers(0, 2**32 - 1)


def segments(seed: int, k: int) -> list[np.ndarray]:
    """Random ones, and as many that are parallel, crossing, touching, or points."""
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.uniform(-1, 1, (4, k, 3))
    d[0] = c[0] + 0.7 * (b[0] - a[0])  # parallel
    middle = (a[1] + b[1]) / 2
    c[1], d[1] = middle + (c[1] - d[1]) / 2, middle - (c[1] - d[1]) / 2  # crossing
    c[2] = b[2]  # touching
    b[3] = a[3]  # a point
    d[4] = c[4]
    b[5], d[5] = a[5], c[5]
    return [a, b, c, d]


def pairs(a: Any, b: Any, c: Any, d: Any) -> Nearest:
    """The kernel's answer for segments a-b and c-d, each (k, 3)."""
    k = len(a)
    return nearest(np.stack([a, b], axis=1), np.arange(k), np.stack([c, d], axis=1).reshape(2 * k, 3), 2 * np.arange(k))


def plain(a: Any, b: Any, c: Any, d: Any) -> float:
    """The distance of two segments as the least of its candidates: the lines' crossing, and each end to the other."""

    def to(p: Any, q: Any, e: Any) -> float:
        way = e - q
        share = np.clip((p - q) @ way / max(way @ way, 1e-300), 0.0, 1.0)
        return float(np.linalg.norm(p - q - share * way))

    found = [to(a, c, d), to(b, c, d), to(c, a, b), to(d, a, b)]
    m = np.stack([b - a, c - d], axis=1)
    if np.linalg.matrix_rank(m, 1e-9) == 2:
        shares = np.linalg.lstsq(m, c - a)[0]
        if (shares >= 0).all() and (shares <= 1).all():
            found.append(float(np.linalg.norm(m @ shares - (c - a))))
    return min(found)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_nearest_points_are_those_of_the_least_candidate(seed):
    a, b, c, d = segments(seed, 12)
    found = pairs(a, b, c, d)
    for i in range(12):
        assert found.distance[i] == pytest.approx(plain(a[i], b[i], c[i], d[i]), abs=1e-12)
    on_first, on_second = a + found.on_segment[:, None] * (b - a), c + found.on_link[:, None] * (d - c)
    assert np.linalg.norm(on_second - on_first, axis=1) == pytest.approx(found.distance, abs=1e-12)
    assert ((found.on_segment >= 0) & (found.on_segment <= 1) & (found.on_link >= 0) & (found.on_link <= 1)).all()
    assert on_second - on_first == pytest.approx((found.distance * found.normal).T, abs=1e-12)
    assert found.along == pytest.approx(((b - a) * found.normal.T).sum(axis=1), abs=1e-12)
    points = between(np.stack([a, b], axis=1), np.arange(12), found.on_segment)
    assert np.abs(points.T - on_first).max() < 1e-12


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_many_configurations_at_once_are_each_one_s(seed):
    rng = np.random.default_rng(seed)
    ends, nodes = rng.uniform(-1, 1, (5, 2, 3)), rng.uniform(-1, 1, (4, 6, 3))
    body, links = rng.integers(0, 5, 9), rng.integers(0, 5, 9)
    found = nearest(ends, body, nodes, links)
    for i in range(4):
        each = nearest(ends, body, nodes[i], links)
        for whole, one in zip(found, each, strict=True):
            assert np.array_equal(whole[..., i, :], one)
        straight = [plain(*ends[s], nodes[i, j], nodes[i, j + 1]) for s, j in zip(body, links, strict=True)]
        assert each.distance == pytest.approx(straight, abs=1e-12)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_nearest_points_against_a_constrained_least_squares_solver(seed):
    a, b, c, d = segments(seed, 8)
    found = pairs(a, b, c, d)
    for i in range(8):
        # min |a + s u - c - t v| with 0 <= s, t <= 1
        best = lsq_linear(np.stack([b[i] - a[i], c[i] - d[i]], axis=1), c[i] - a[i], (0, 1), tol=1e-14)
        assert found.distance[i] == pytest.approx(np.sqrt(2 * best.cost), abs=1e-6)


def test_a_kernel_that_has_begun_needs_no_more_memory():
    rng = np.random.default_rng(0)
    ends, path = rng.uniform(-1, 1, (29, 2, 3)), rng.uniform(-1, 1, (24, 7))
    body, links, arms = rng.integers(0, 29, 200), rng.integers(1, 8, 200), human_srl().arms

    def once() -> None:
        nearest(ends, body, link_nodes(arms, "right", path), links)

    for _ in range(20):
        once()
    tracemalloc.start()
    try:
        once()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(200):
            once()
        assert tracemalloc.get_traced_memory()[0] - before < 10_000  # bytes; the results of one call are 140 kB
    finally:
        tracemalloc.stop()


def test_distances_against_coal():
    a, b, c, d = segments(1, 200)
    found = pairs(a, b, c, d).distance - 0.05 - 0.03
    for i in range(6, 200):  # a capsule of coal has a length
        shapes, places = [], []
        for p, q, r in ((a[i], b[i], 0.05), (c[i], d[i], 0.03)):
            z = (q - p) / np.linalg.norm(q - p)
            x = np.cross(z, [0.3, 0.5, 0.81])
            x /= np.linalg.norm(x)
            shapes.append(coal.Capsule(r, float(np.linalg.norm(q - p))))
            places.append(coal.Transform3s(np.stack([x, np.cross(z, x), z], axis=1), (p + q) / 2))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.enable_signed_distance = True
        coal.distance(shapes[0], places[0], shapes[1], places[1], request, result)
        assert found[i] == pytest.approx(result.min_distance, abs=1e-6)


def test_distances_against_mujoco():
    a, b, c, d = segments(2, 100)
    spec = mujoco.MjSpec()
    for i in range(6, 100):
        for j, (p, q, r) in enumerate(((a[i], b[i], 0.05), (c[i], d[i], 0.03))):
            spec.worldbody.add_geom(
                name=f"{i}/{j}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*p, *q], size=[r, 0, 0]
            )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = pairs(a, b, c, d).distance - 0.08
    for i in range(6, 100):
        two = model.geom(f"{i}/0").id, model.geom(f"{i}/1").id
        assert found[i] == pytest.approx(mujoco.mj_geomDistance(model, data, *two, 10.0, None), abs=1e-6)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_arm_s_nodes_are_those_of_the_whole_skeleton(side):
    figure = human_srl()
    whole = Kinematics(figure)
    path = np.stack([np.zeros(7), TWO, THREE, -THREE])
    made = link_nodes(figure.arms, side, path)
    joints = list(figure.human.joints)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
    for q, nodes in zip(path, made, strict=True):
        found = whole.nodes(still, figure.human.offsets[joints], {side: q})
        carrier = found[figure.tree.index(figure.arms.parent)]
        assert nodes == pytest.approx(found[figure.arm[side]] - carrier, abs=1e-12)


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_no_point_of_a_link_moves_farther_than_its_reach_says(seed):
    rng = np.random.default_rng(seed)
    arms = human_srl().arms
    low, high = np.full(7, -2.0), np.full(7, 2.0)
    low[4], high[4] = 0.0, 0.1
    reach = reaches(arms, "right", low, high)
    q = rng.uniform(low, high)
    p = np.clip(q + rng.normal(size=7) * rng.choice([1e-3, 0.3]), low, high)
    before, after = link_nodes(arms, "right", np.stack([q, p]))
    moved = np.linalg.norm(after - before, axis=1)
    assert (np.maximum(moved[:-1], moved[1:]) <= np.abs(p - q) @ reach + 1e-12).all()
    for i in range(7):  # and it isn't idle: a joint that moves a link has a reach there
        one = q.copy()
        one[i] = p[i]
        gone = np.linalg.norm(np.subtract(*link_nodes(arms, "right", np.stack([q, one]))), axis=1)
        assert ((np.maximum(gone[:-1], gone[1:]) > 1e-12) <= (reach[i] > 0)).all()
