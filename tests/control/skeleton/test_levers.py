"""Bounds by the posture's own levers: a search for motions of an arm and places of a body that are worse."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.worn_levers import ARMS, HIGH, LOW, UNIT, N, somewhere, way_of

from srl.control.shared.approach import Separation
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import jacobian, link_nodes, posture
from srl.runtime.contracts.signals import Array

LINKS = np.arange(1, N + 1)
NOTHING = Separation(0.0, 0.0, 0.0)


def link_ends(places: Array) -> Array:
    """(p, k, 2, 3) m."""
    nodes = link_nodes(ARMS, "right", places)
    return np.stack([nodes[:, 1:-1], nodes[:, 2:]], axis=2)


def test_the_jacobian_is_that_of_the_nodes():
    rng = np.random.default_rng(0)
    for q in rng.uniform(LOW, HIGH, (20, N)):
        J = jacobian(ARMS, *posture(ARMS, "right", q[None]))[:, 0]
        h = 1e-5
        for i in range(N):
            e = h * np.eye(N)[i]
            ahead, behind = link_nodes(ARMS, "right", np.array([q + e, q - e]))
            assert pytest.approx((ahead - behind) / (2 * h), abs=1e-8) == J[:, :, i].T


@pytest.mark.parametrize("seed", range(6))
def test_no_error_of_a_joint_and_no_place_on_a_piece_is_nearer_than_the_margin(seed):
    """In every piece the joints are anywhere between its ends, each by itself, and off by up to sigma."""
    rng, found, tight = np.random.default_rng(seed), [], []
    for _ in range(60):
        start = rng.uniform(LOW, HIGH)
        step = rng.normal(size=N) * UNIT * rng.choice([0.0, 0.01, 0.1])
        sigma = rng.uniform(0, 1, N) * UNIT * rng.choice([0.0, 0.02, 0.1])
        path = np.array([start, start + step])
        way = way_of(path, sigma)
        body = somewhere(rng, way.nodes[0])
        seen = nearest(body, np.zeros(N, np.intp), way.nodes, LINKS)
        s, along = seen.on_segment, seen.along
        height = np.stack([seen.distance + s * along, seen.distance - (1 - s) * along], axis=-1)
        levers = way.levers(seen, LINKS)
        margin, gap = (each[0] for each in way.close(levers, height, np.zeros_like(height), LINKS, 0.0, NOTHING))
        lever = np.einsum("xmk,xmkfi->mkfi", levers.normal, levers.jacobian)
        worst = [np.sign(-lever[m, k, f]) * sigma for m in (0, 1) for k in range(N) for f in (0, 1)]
        errors = np.array([*worst, *rng.uniform(-sigma, sigma, (20, N)), *rng.choice([-1, 1], (20, N)) * sigma])
        shares = np.concatenate([rng.integers(0, 2, (len(errors), N)), rng.uniform(0, 1, (len(errors), N)),
                                 np.zeros((len(errors), N)), np.ones((len(errors), N))])  # fmt: skip
        places = start + shares * step + np.tile(errors, (4, 1))
        distance = nearest(body, np.zeros(N, np.intp), link_nodes(ARMS, "right", places), LINKS).distance.min(axis=0)
        found.append((distance - margin).min())
        ahead = np.einsum("xk,pkfx->pkf", levers.normal[:, 0], link_ends(places) - body[0, 0])
        behind = np.einsum("xk,x->k", levers.normal[:, 0], body[0, 1] - body[0, 0])
        found.append((ahead.min(axis=(0, 2)) - np.maximum(behind, 0.0) - gap).min())
        if seen.distance[0].min() > 0.05 and sigma.any():
            tight.append(((seen.distance[0] - margin) / (way.slack[1:] + way.travel[0, 1:]))[-1])
    assert min(found) >= -1e-9
    assert np.median(tight) < 0.7, "by the farthest reach it would be up to 1"
