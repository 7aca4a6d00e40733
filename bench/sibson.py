"""Sibson's coordinates in a cycle, beside scipy's linear interpolation on the same triangulation.

Both interpolate nine values, the direction and range of one degree of freedom, at one point inside the sites' hull. The
other is only piecewise linear, so it does less; scipy has no natural-neighbour interpolation.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from bench.pairs import Row, measure
from runtime.contracts.signals import Array
from runtime.control.ikns.sibson import Sibson

BLOCK = 400  # queries measured one after another
AIM = 60.0  # us with ten sites


def run() -> list[Row]:
    """Compares them with 10, 50 and 200 sites."""
    return [_row(n) for n in (10, 50, 200)]


def _sites(n: int) -> Array:
    """A calibration's ten points jittered by 20 mm, or points at random, m."""
    rng = np.random.default_rng(n)
    if n != 10:
        return rng.uniform(-0.3, 0.3, (n, 3))
    box = np.array([*product((-0.2, 0.2), (-0.15, 0.15), (-0.25, 0.25)), (0, 0, -0.25), (0, 0, 0.25)])
    return box + rng.normal(size=box.shape) * 0.02


def _row(n: int) -> Row:
    sites, rng = _sites(n), np.random.default_rng(1)
    values = rng.normal(size=(n, 9))
    points = rng.dirichlet(np.ones(n), BLOCK) @ sites
    if n != 10:  # mixtures of many are all in the middle
        points = rng.uniform(-0.15, 0.15, (BLOCK, 3))
    sibson, linear = Sibson(sites), LinearNDInterpolator(sites, values)
    pairs = measure(
        lambda: _timed(lambda x: sibson.weights(x).dot(values), points),
        {"LinearNDInterpolator": lambda: _timed(linear, points)},
    )
    aim = f"{AIM:g} us" if n == 10 else ""
    row = pairs.row("sibson", f"{n} sites, nine values at a point", "query", "LinearNDInterpolator", "us", aim)
    return replace(row, holds=row.ours <= AIM) if aim else row


def _timed(query: Callable[[Array], object], points: Array) -> dict[str, float]:
    took = []
    for x in points:
        begun = time.perf_counter_ns()
        query(x)
        took.append(time.perf_counter_ns() - begun)
    return {"query": statistics.median(took) / 1e3}
