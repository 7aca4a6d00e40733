"""An arm like that of `human-srl`, and what is beside it, for searches of counterexamples."""

from __future__ import annotations

import numpy as np

from srl.control.skeleton.envelope import reaches
from srl.control.skeleton.levers import Way
from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import ArmsModel

ARMS = ArmsModel(base=(-0.15, 0.05, 0.35)).arms
N = ARMS.n
LOW, HIGH = np.array([-1.6, -1.4, -1.6, -1.9, 0.0, -1.6, -2.6]), np.array([1.0, 0.3, 1.6, 1.9, 0.1, 1.6, 2.6])
UNIT = np.where([joint.slides for joint in ARMS.joints], 0.1, 1.0)  # m where a joint slides
REACH = reaches(ARMS, "right", np.full(N, -0.2), np.full(N, 0.2))


def somewhere(rng: np.random.Generator, nodes: Array) -> Array:
    """(1, 2, 3) m: a segment of any length, beside the arm or through it."""
    start = nodes[rng.integers(1, len(nodes))] + rng.normal(size=3) * rng.choice([0.02, 0.1, 0.4])
    return np.array([[start, start + rng.normal(size=3) * rng.choice([1e-9, 0.05, 0.4])]])


def way_of(path: Array, sigma: Array, rates: Array | None = None) -> Way:
    most = np.zeros(N) if rates is None else np.abs(rates).max(axis=0)
    motion = Braking(path, np.zeros(len(path)), most, sigma, rates, np.zeros(N))
    return Way(ARMS, "right", np.arange(N), REACH, motion)
