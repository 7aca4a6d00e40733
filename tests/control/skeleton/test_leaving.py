"""Leaving what is too near: a search for a body that is where the cone says that it can't be, and for an arm's motion
that closes a distance by more than the bound."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.worn_levers import ARMS, HIGH, LOW, UNIT, N, somewhere, way_of

from srl.control.shared.approach import Separation
from srl.control.shared.leaving import NONE, closing, contact_cone
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import jacobian, posture
from srl.runtime.contracts.signals import Array

ONE = np.zeros(1, np.intp)


def within(rng: np.random.Generator, r: float, count: int) -> Array:
    """(count, 3), no longer than r; half of them as long."""
    way = rng.normal(size=(count, 3))
    size = np.where(rng.random(count) < 0.5, 1.0, rng.random(count)) * r
    moved: Array = way / np.linalg.norm(way, axis=1)[:, None] * size[:, None]
    return moved


def behind(moved: Array, n: Array, most: float) -> Array:
    """These ways, none of them farther along n than `most`."""
    along = moved @ n
    return moved - np.maximum(along - most, 0.0)[:, None] * n


def test_what_touches_after_it_moved_touches_within_the_cone():
    rng, checked, worst = np.random.default_rng(0), 0, 1.0
    for _ in range(400):
        other = rng.normal(size=(1, 2, 3)) * rng.choice([0.05, 0.3])
        own = rng.normal(size=(2, 3)) * rng.choice([0.05, 0.3]) + [0.2, 0.0, 0.0]
        seen = nearest(other, ONE, own, ONE)
        D, n = float(seen.distance[0]), seen.normal[:, 0]
        r, touching = float(rng.uniform(0, 1.2)) * D, float(rng.uniform(0.2, 2.0)) * D
        half = float(rng.uniform(0, 1))
        nearer = float(rng.choice([0.0, 0.2, 1.0])) * r  # by which both may come along the normal, together
        cosine = float(contact_cone(np.array(D - nearer), np.array(D), np.array(r), touching))
        for _ in range(60):
            y = other + behind(within(rng, half * r, 2), n, half * nearer)[None]
            x = own + behind(within(rng, (1 - half) * r, 2), -n, (1 - half) * nearer)
            moved = nearest(y, ONE, x, ONE)
            if moved.distance[0] <= touching and moved.distance[0] > 1e-6:
                checked += 1
                assert cosine <= 1.0
                assert float(moved.normal[:, 0] @ n) >= cosine - 1e-7
                if cosine > -1:
                    worst = min(worst, float(moved.normal[:, 0] @ n) - cosine)
    assert checked > 3000
    assert worst < 0.02, "the bound is nearly met"


def test_asin_of_r_over_d_would_not_do_for_segments():
    """Found by a search: the normal turns farther than that of two points could."""
    own = np.array([[-0.082, 0.217, 0.201], [0.126, -0.076, -0.107]])
    other = np.array([[[0.06, -0.038, 0.07], [-0.055, -0.042, 0.085]]])
    seen = nearest(other, ONE, own, ONE)
    moved = nearest(other + np.array([[-0.053, -0.037, -0.009], [0.004, 0.046, -0.046]]), ONE, own, ONE)
    D, r = float(seen.distance[0]), 0.0653
    cosine = float(moved.normal[:, 0] @ seen.normal[:, 0])
    assert 1 - r / D <= cosine < np.sqrt(1 - (r / D) ** 2) - 0.3


@pytest.mark.parametrize("cosine", [1.5, 1.0, 0.6, 0.0, -0.5, -1.0])
def test_closing_is_the_worst_of_all_normals_in_the_cone(cosine):
    rng = np.random.default_rng(1)
    for _ in range(50):
        v, n = rng.normal(size=(3, 2)), rng.normal(size=3)
        n /= np.linalg.norm(n)
        found = float(closing(v[:, None], n[:, None], np.array([cosine]))[0])
        if cosine > 1:
            assert found == NONE
            continue
        normals = rng.normal(size=(4000, 3))
        across = normals - normals @ n[:, None] * n
        across /= np.linalg.norm(across, axis=1)[:, None]
        c = rng.uniform(cosine, 1, 4000)
        c[:2000] = cosine
        normals = c[:, None] * n + np.sqrt(1 - c**2)[:, None] * across
        worst = float((-normals @ v).max())
        size = float(np.linalg.norm(v, axis=0).max())
        assert worst <= found + 1e-9
        assert worst >= found - 0.12 * size


@pytest.mark.parametrize("seed", range(4))
def test_no_body_within_its_bound_is_approached_at_over_what_is_said(seed):
    """The arm is anywhere on a piece and off by sigma, the body moved by r at each end: at a touch the arm closes in by
    no more than `Way.closing`."""
    rng, checked, leaves = np.random.default_rng(seed), 0, 0
    for _ in range(60):
        start = rng.uniform(LOW, HIGH)
        rates = rng.normal(size=(3, N)) * 0.5 * UNIT
        rates[2] = rates[0] * rng.uniform(0, 1) if rng.random() < 0.5 else rates[2]
        step = rng.uniform(0, 0.02) * rates[2]
        sigma = rng.uniform(0, 1, N) * UNIT * rng.choice([0.0, 0.005, 0.02])
        path = np.array([start, start + step, start + 2 * step])
        way = way_of(path, sigma, rates)
        body, link = somewhere(rng, way.nodes[0]), np.array([rng.integers(1, N + 1)])
        seen = nearest(body, ONE, way.nodes, link)
        r, touching = float(rng.uniform(0, 0.1)), float(rng.uniform(0.05, 0.15))
        s, along = seen.on_segment, seen.along
        height = np.stack([seen.distance + s * along, seen.distance - (1 - s) * along], axis=-1)
        levers, needed = way.levers(seen, link), Separation(0.0, 0.0, r)
        gap = way.close(levers, height, np.zeros_like(height), link, 0.0, needed)[1]
        said = float(way.closing(levers, link, gap, seen.distance, np.full((2, 1), r), touching)[0])
        leaves += said <= 0.02
        for _ in range(80):
            piece = rng.integers(0, 2)
            q = path[piece] + rng.uniform(0, 1, N) * step + rng.uniform(-sigma, sigma)
            v = rng.dirichlet([0.3, 0.3, 0.3]) @ rates if piece == 0 else rng.uniform(0, 1) * rates[2]
            nodes, axes = posture(ARMS, "right", q[None])
            moved = nearest(body + within(rng, r, 2)[None], ONE, nodes, link)
            if 1e-6 < moved.distance[0, 0] <= touching:
                checked += 1
                ends = jacobian(ARMS, nodes, axes)[:, 0, [link[0], link[0] + 1]] @ v
                t = moved.on_link[0, 0]
                speed = -moved.normal[:, 0, 0] @ (ends[:, 0] * (1 - t) + ends[:, 1] * t)
                assert speed <= said + 1e-9
    assert checked > 300
    assert leaves > 2
