"""Sibson's coordinates: what they must fulfil, and the stolen volumes counted point by point."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from srl.control.ikns.delaunay import SitesError
from srl.control.ikns.sibson import Sibson
from srl.runtime.contracts.signals import Array

# The calibration's points: the corners of a box and the centres of its lower and upper face, m.
BOX = np.array([*product((-0.2, 0.2), (-0.15, 0.15), (-0.25, 0.25)), (0.0, 0.0, -0.25), (0.0, 0.0, 0.25)])


def jittered(seed: int, by: float = 0.02) -> Array:
    return BOX + np.random.default_rng(seed).normal(size=BOX.shape) * by


def turned(seed: int) -> Array:
    return BOX @ Rotation.random(rng=np.random.default_rng(seed)).as_matrix().T + [0.3, -0.2, 1.1]


def scattered(n: int) -> Array:
    return np.random.default_rng(n).uniform(-0.3, 0.3, (n, 3))


SITES = {
    "box": BOX,
    **{f"box turned {k}": turned(k) for k in range(3)},
    **{f"box jittered {k}": jittered(k) for k in range(4)},
    **{f"box jittered by {by:g}": jittered(9, by) for by in (1e-4, 1e-6, 1e-14)},
    "grid": np.array([*product((0.0, 0.1, 0.2), repeat=3)]),
    "four": scattered(4),
    "thirty": scattered(30),
    "two hundred": scattered(200),
}
some = pytest.mark.parametrize("sites", SITES.values(), ids=SITES)


def mixed(corners: Array, n: int, rng: np.random.Generator) -> Array:
    """(m n, 3): n random points of each simplex of m, corners (m, k, 3)."""
    return np.concatenate([rng.dirichlet(np.ones(corners.shape[1]), n) @ c for c in corners])


def queries(sites: Array) -> dict[str, Array]:
    """Points in the hull, (n, 3) each, where such coordinates may fail."""
    rng = np.random.default_rng(5)
    tets = sites[Delaunay(sites).simplices][:60]
    hull = ConvexHull(sites)
    # Points in the planes of facets, and on the lines of edges, beyond them.
    plane = np.array([[1.0, 0.8, -0.8], [0.9, -0.5, 0.6], [2.0, -1.2, 0.2]]) @ tets[:, :3]
    line = np.array([[1.4, -0.4], [-0.2, 1.2]]) @ tets[:, :2]
    beyond = np.concatenate([plane.reshape(-1, 3), line.reshape(-1, 3)])
    middle = sites.mean(axis=0)
    return {
        "inside": rng.dirichlet(np.ones(len(sites)), 200) @ sites,
        "in a tetrahedron": mixed(tets, 3, rng),
        "facets": mixed(tets[:, :3], 3, rng),
        "edges": mixed(tets[:, :2], 3, rng),
        "planes and lines": beyond[(beyond @ hull.equations[:, :3].T + hull.equations[:, 3] <= 0.0).all(axis=1)],
        "hull's facets": mixed(sites[hull.simplices][:60], 3, rng),
        "hull's edges": mixed(sites[hull.simplices][:60, :2], 3, rng),
        "sites": sites,
        **{f"{r:g} m from sites": sites + r * (middle - sites) for r in (1e-3, 1e-6, 1e-9, 1e-12)},
        "middle": middle[None],
    }


@some
def test_weights_are_a_mean_that_gives_the_point(sites: Array) -> None:
    sibson = Sibson(sites)
    for kind, points in queries(sites).items():
        w = np.array([sibson.weights(x) for x in points]).reshape(-1, len(sites))
        assert w.min(initial=0.0) >= 0.0, kind
        assert np.abs(w.sum(axis=1) - 1.0).max(initial=0.0) < 1e-12, kind
        # Three sites on an edge of the hull, as the grid has, cost a digit there.
        assert np.abs(w @ sites - points).max(initial=0.0) < (1e-9 if len(sites) != 27 else 1e-8), kind


@some
def test_one_at_a_site(sites: Array) -> None:
    sibson = Sibson(sites)
    assert np.abs([sibson.weights(x) for x in sites] - np.eye(len(sites))).max() < 1e-8


@pytest.mark.parametrize("sites", [k for n, k in SITES.items() if " by " not in n])
def test_continuous_along_lines_through_facets_sites_and_the_hull(sites: Array) -> None:
    """In steps of 0.1 mm and of 1 nm, from site to site and through facets of the hull to far outside.

    Near a hull that is almost flat Sibson's coordinates themselves are steep: up to 0.3 in a millimetre with a box
    jittered by 20 mm. So the bounds are wide, and the small steps tell a jump.
    """
    sibson, rng = Sibson(sites), np.random.default_rng(3)
    hull = ConvexHull(sites)
    for _ in range(4):
        i, k = rng.choice(len(sites), 2, replace=False)
        foot = rng.dirichlet(np.ones(3)) @ sites[hull.simplices[rng.integers(len(hull.simplices))]]
        over = (foot - sites.mean(axis=0)) / np.linalg.norm(foot - sites.mean(axis=0))
        along = (sites[k] - sites[i]) / np.linalg.norm(sites[k] - sites[i])
        for start, way in ((sites[i], along), (foot, over), (foot, -over)):
            for step, most in ((1e-4, 0.1), (1e-9, 1e-6)):
                line = start + way * np.arange(0.0, 100 * step, step)[:, None]
                w = np.array([sibson.weights(x) for x in line])
                assert np.abs(np.diff(w, axis=0)).max() < most


@pytest.mark.parametrize("sites", [BOX, jittered(0), turned(1)])
def test_the_hull_is_reached_without_a_jump(sites: Array) -> None:
    """From 1 nm inside a facet to the facet, and from there to 1 m outside."""
    sibson, rng, hull = Sibson(sites), np.random.default_rng(1), ConvexHull(sites)
    for corners, normal in zip(sites[hull.simplices], hull.equations[:, :3], strict=True):
        foot = rng.dirichlet(np.ones(3)) @ corners
        at = sibson.weights(foot)
        assert np.abs(sibson.weights(foot - 1e-9 * normal) - at).max() < 1e-6
        assert np.abs(sibson.weights(foot + normal) - at).max() < 1e-6


@pytest.mark.parametrize("seed", [None, *range(3)])
def test_outside_it_is_the_nearest_point_of_the_hull(seed: int | None) -> None:
    """Against a general minimiser of the distance over mixtures of sites."""
    from scipy.optimize import nnls

    sites = BOX if seed is None else jittered(seed)
    sibson, rng = Sibson(sites), np.random.default_rng(4)
    for x in rng.normal(size=(60, 3)) * 0.6:
        # min |s' lambda - x| with sum lambda = 1, the sum held by a heavy row
        mix, _ = nnls(np.vstack([sites.T, np.full(len(sites), 1e4)]), np.append(x, 1e4), maxiter=1000)
        best = mix @ sites / mix.sum()
        found = sibson.nearest(x)
        assert found.point == pytest.approx(best, abs=1e-6)
        assert found.distance == pytest.approx(np.linalg.norm(best - x), abs=1e-6)
        assert sibson.weights(x) @ sites == pytest.approx(found.point, abs=1e-9)


def counted(sites: Array, x: Array, n: int) -> tuple[Array, int]:
    """Weights (N,) as shares of random points nearer to x than to every site, and how many those are."""
    rng, half = np.random.default_rng(7), 0.02
    while True:
        y = x + rng.uniform(-half, half, (n, 3))
        d = ((y[:, None] - sites) ** 2).sum(axis=2)
        stolen = ((y - x) ** 2).sum(axis=1) < d.min(axis=1)
        if np.abs(y[stolen] - x).max() < 0.9 * half:
            return np.bincount(d[stolen].argmin(axis=1), minlength=len(sites)) / stolen.sum(), int(stolen.sum())
        half *= 1.25


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("sites", [BOX, jittered(0), scattered(12)], ids=["box", "jittered", "scattered"])
def test_the_volumes_are_those_that_points_count(sites: Array) -> None:
    """The independent check. Nothing of Delaunay is in it."""
    sibson, rng, checked = Sibson(sites), np.random.default_rng(2), 0
    middle = sites.mean(axis=0)
    for x in [middle, *(middle + 0.5 * (rng.dirichlet(np.ones(len(sites)), 5) @ sites - middle))]:
        w, n = counted(sites, x, 100_000)
        if n > 2000:  # a cell that reaches far out holds few of them
            assert np.abs(sibson.weights(x) - w).max() < 4.5 * 0.5 / np.sqrt(n)
            checked += 1
    assert checked >= 4


def test_neither_order_nor_place_nor_size_matters() -> None:
    rng = np.random.default_rng(6)
    turn, place = Rotation.random(rng=rng), np.array([3.0, -2.0, 1.0])
    for sites in (BOX, jittered(0), scattered(20)):
        order = rng.permutation(len(sites))
        plain, mixed, moved = Sibson(sites), Sibson(sites[order]), Sibson(100.0 * turn.apply(sites) + place)
        for x in rng.dirichlet(np.ones(len(sites)), 40) @ sites:
            w = plain.weights(x)
            assert mixed.weights(x) == pytest.approx(w[order], abs=1e-9)
            assert moved.weights(100.0 * turn.apply(x) + place) == pytest.approx(w, abs=1e-9)


def test_a_query_that_isnt_finite_gives_no_weights() -> None:
    assert not np.isfinite(Sibson(BOX).weights(np.array([np.nan, 0.0, 0.0]))).all()


@pytest.mark.parametrize("by", [1e-7, 3e-8, 1e-8, 1e-9, 2e-10, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12, 1e-13])
def test_where_double_precision_cant_tell_sites_move_by_micrometres(by: float) -> None:
    """Faces of the box flat to a nanometre and yet not flat."""
    for seed in range(6):
        sites = jittered(seed, by)
        sibson = Sibson(sites)
        for points in queries(sites).values():
            assert np.abs([sibson.weights(x) @ sites - x for x in points]).max(initial=0.0) < 1e-5


@pytest.mark.parametrize(
    ("sites", "reason"),
    [
        (BOX[:3], "four points or more"),
        (BOX[:, :2], "four points or more"),
        (BOX * [1.0, 1.0, 0.0] + np.arange(10)[:, None] * [1e-3, 0, 0], "not a volume: 0.0 mm rms"),
        (BOX * [1.0, 0.0, 0.0] + np.arange(10)[:, None] * [1e-3, 0, 0], "not a volume"),
        (np.vstack([BOX, BOX[:1]]), "sites (1 and 11|11 and 1) are in the same place"),
        (np.where(np.arange(10)[:, None] == 4, np.nan, BOX), "site 5 isn't finite"),
    ],
)
def test_sites_that_cant_do_are_refused_with_the_reason(sites: Array, reason: str) -> None:
    with pytest.raises(SitesError, match=reason):
        Sibson(sites)
