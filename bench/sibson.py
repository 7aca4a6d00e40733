"""Sibson's coordinates in a cycle, beside other interpolations of the same values at the same points.

Ours and scipy's interpolate nine values, the direction and range of one degree of freedom, at one point inside the
sites' hull; scipy's is only piecewise linear. natinterp3d is natural-neighbour interpolation in 3D in C, one value a
call here; it is not exact (linear functions break by millimetres), so it is a peer in speed alone. metpy's is in 2D,
one value. The last two are measured if they are installed: `pip install natinterp3d metpy`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from bench.pairs import Row, measure
from srl.control.ikns.sibson import Sibson
from srl.runtime.contracts.signals import Array

BLOCK = 400  # queries measured one after another
AIM = 60.0  # us with ten sites


def run() -> list[Row]:
    """Compares them with 10, 50 and 200 sites."""
    return [row for n in (10, 50, 200) for row in _rows(n)]


def _sites(n: int) -> Array:
    """A calibration's ten points jittered by 20 mm, or points at random, m."""
    rng = np.random.default_rng(n)
    if n != 10:
        return rng.uniform(-0.3, 0.3, (n, 3))
    box = np.array([*product((-0.2, 0.2), (-0.15, 0.15), (-0.25, 0.25)), (0, 0, -0.25), (0, 0, 0.25)])
    return box + rng.normal(size=box.shape) * 0.02


def _rows(n: int) -> list[Row]:
    sites, rng = _sites(n), np.random.default_rng(1)
    values = rng.normal(size=(n, 9))
    points = rng.dirichlet(np.ones(n), BLOCK) @ sites
    if n != 10:  # mixtures of many are all in the middle
        points = rng.uniform(-0.15, 0.15, (BLOCK, 3))
    sibson, others = Sibson(sites), _others(sites, values)
    pairs = measure(
        lambda: _timed(lambda x: sibson.weights(x).dot(values), points),
        {name: lambda query=query: _timed(query, points) for name, query in others.items()},  # type: ignore[misc]
    )
    rows = []
    for name in others:
        aim = f"{AIM:g} us" if n == 10 else ""
        row = pairs.row("sibson", f"{n} sites, a point", "query", name, "us", aim)
        rows.append(replace(row, holds=row.ours <= AIM) if aim else row)
    return rows


def _others(sites: Array, values: Array) -> dict[str, Callable[[Array], object]]:
    """The queries of the peers that are installed."""
    found: dict[str, Callable[[Array], object]] = {"LinearNDInterpolator": LinearNDInterpolator(sites, values)}
    natural: Any = _imported("natinterp3d")
    if natural is not None:
        interpolator, one = natural.Interpolator(sites), np.ascontiguousarray(values[:, 0])
        found["natinterp3d, one value"] = lambda x: interpolator.interpolate(x[None], one)
    metpy: Any = _imported("metpy.interpolate")
    if metpy is not None and len(sites) == 10:  # seconds a block with more
        plane, one = np.ascontiguousarray(sites[:, :2]), values[:, 0]
        found["metpy in 2D, one value"] = lambda x: metpy.natural_neighbor_to_points(plane, one, x[None, :2])
    return found


def _imported(name: str) -> object | None:
    try:
        return import_module(name)
    except ImportError:
        return None


def _timed(query: Callable[[Array], object], points: Array) -> dict[str, float]:
    took = []
    for x in points:
        started = time.perf_counter_ns()
        query(x)
        took.append(time.perf_counter_ns() - started)
    return {"query": statistics.median(took) / 1e3}
