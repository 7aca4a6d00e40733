"""Delaunay cells of sites in three dimensions, for Sibson's coordinates.

Sites on one sphere have no unique triangulation, and libraries return flat tetrahedra among them. Here they are one
cell: the tetrahedra of one sphere are joined, and only the cell's outer facets are kept. Flat tetrahedra on the hull
hold no volume and are left away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array

Indices = NDArray[np.intp]

_FLAT: Final = 1e-12  # of the size: a tetrahedron thinner than this is flat
_ON_SPHERE: Final = (1e-12, 1e-14)  # of the size squared, and of size times radius: power of a site on a sphere
_IN_PLANE: Final = 1e-12  # of the size
_ALMOST: Final = 1e-7  # of the size: a hull flat to this, and yet not flat, has no digits left for what lies at it
_MOVED: Final = 1e-5  # of the size: how far sites are moved where that is so
_THIN: Final = 1e-3  # of the size: sites within a layer of this thickness span no volume
_SAME: Final = 1e-4  # of the size: sites nearer to each other are one


class SitesError(SrlError):
    """Sites among which nothing can be interpolated."""


@dataclass(frozen=True)
class Cells:
    """The cells, in coordinates whose unit is `size` and whose origin is `origin`.

    Attributes:
        origin: (3,) m; size: m.
        points: (N, 3), the sites.
        centres: (C, 3) of the cells' circumspheres.
        powers: (N, C), of each site to each sphere: squared distance less squared radius.
        facets: (F, 3), sites of each facet, counter-clockwise seen from outside its owner.
        owner: (F,), the cell whose facet it is; beyond: (F,), the cell on the other side, -1 for none.
        plane: (F,), the facet whose plane it shares, for hull facets in one plane; else itself.
        normals: (F, 3), outwards; those of facets in one plane agree to the bit.
    """

    origin: Array
    size: float
    points: Array
    centres: Array
    powers: Array
    facets: Indices
    owner: Indices
    beyond: Indices
    plane: Indices
    normals: Array


def delaunay(sites: Array) -> Cells:
    """Returns the cells of sites (N, 3) m. Raises SitesError: too few, not finite, two in one place, no volume.

    Where sites lie in one plane to 1e-7 of their size and yet not exactly, each is moved by 1e-5 of it at most.
    """
    origin, size = _checked(sites)
    points = (sites - origin) / size
    moved = points + np.random.default_rng(0).uniform(-_MOVED, _MOVED, points.shape) / np.sqrt(3.0)
    for tried in (points, moved):
        cells = _cells(origin, size, tried)
        if cells is not None:
            return cells
    raise SitesError("sites", "no triangulation of them is exact enough", "Move some of them by a millimetre")


def _cells(origin: Array, size: float, points: Array) -> Cells | None:
    """The cells, or None where double precision doesn't suffice."""
    from scipy.spatial import Delaunay

    found = Delaunay(points)
    tets, beyond = found.simplices.astype(np.intp), found.neighbors.astype(np.intp)
    corners = points[tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    # scipy doesn't promise an orientation.
    back = volumes < 0.0
    tets[back, :2], beyond[back, :2] = tets[back, 1::-1], beyond[back, 1::-1]
    thickness = _thickness(points[tets], np.abs(volumes))
    tets, beyond, thickness = _peeled(tets, beyond, thickness)
    _turn_flat(tets, beyond, thickness)
    cell, centres, powers = _joined(points, tets, beyond, thickness)
    t, j = np.nonzero((beyond < 0) | (cell[:, None] != cell[beyond]))
    facets = tets[t[:, None], _OPPOSITE[j]]
    behind = np.where(beyond[t, j] < 0, -1, cell[beyond[t, j]])
    cells = Cells(origin, size, points, centres, powers, facets, cell[t], behind, *_planes(points, facets, behind))
    almost = (thickness[(beyond < 0).any(axis=1)] < _ALMOST).any() or _almost_flat(cells)
    return cells if not almost and _closed(cells) else None


# The corners of the facet opposite each corner of a positive tetrahedron, counter-clockwise from outside.
_OPPOSITE: Final = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


def _checked(sites: Array) -> tuple[Array, float]:
    """Returns the sites' mean and size."""
    place = "sites"
    if sites.ndim != 2 or sites.shape[1:] != (3,) or len(sites) < 4:
        raise SitesError(
            place, f"{list(sites.shape)} isn't the shape (N, 3) of four points or more", "Give more points"
        )
    if not np.isfinite(sites).all():
        raise SitesError(place, f"site {int(np.argmin(np.isfinite(sites).all(1))) + 1} isn't finite", "Record it again")
    origin = sites.mean(axis=0)
    spread = np.linalg.svd(sites - origin, compute_uv=False) / np.sqrt(len(sites))  # rms along the principal axes, m
    size = 2.0 * float(spread[0])
    if not spread[2] > _THIN * size:
        raise SitesError(
            place,
            f"they are not a volume: {1e3 * spread[2]:.1f} mm rms from a common plane, of {1e3 * size:.0f} mm in size",
            "Choose points that enclose the workspace, some of them in front and some behind, above and below",
        )
    gaps = np.linalg.norm(sites[:, None] - sites, axis=2) + np.diag(np.full(len(sites), np.inf))
    i, k = np.unravel_index(int(gaps.argmin()), gaps.shape)
    if gaps[i, k] < _SAME * size:
        raise SitesError(place, f"sites {k + 1} and {i + 1} are in the same place", "Leave one of them away")
    return origin, size


def _thickness(corners: Array, volumes: Array) -> Array:
    """The least height of each tetrahedron."""
    areas = [
        np.linalg.norm(np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a]), axis=1) / 2.0
        for a, b, c in _OPPOSITE
    ]
    found: Array = 3.0 * volumes / np.max(areas, axis=0)
    return found


def _peeled(tets: Indices, beyond: Indices, thickness: Array) -> tuple[Indices, Indices, Array]:
    """Leaves away flat tetrahedra on the hull, until there are none."""
    keep = np.ones(len(tets), dtype=bool)
    while True:
        gone = keep & (thickness < _FLAT) & (beyond < 0).any(axis=1)
        if not gone.any():
            break
        keep &= ~gone
        beyond = np.where((beyond >= 0) & gone[beyond], -1, beyond)
    renumbered = np.append(np.cumsum(keep) - 1, -1)
    return tets[keep], renumbered[beyond[keep]], thickness[keep]


def _turn_flat(tets: Indices, beyond: Indices, thickness: Array) -> None:
    """Orders the corners of flat tetrahedra, whose volume has no sign, as those beside them need it. In place."""
    done = thickness >= _FLAT
    heap = done.nonzero()[0].tolist()
    while heap:
        t = heap.pop()
        for j, other in enumerate(beyond[t]):
            if other < 0 or done[other]:
                continue
            a, b, c = tets[t, _OPPOSITE[j]]
            (apex,) = set(tets[other]) - {a, b, c}
            order = [int((tets[other] == v).argmax()) for v in (apex, b, a, c)]
            tets[other], beyond[other] = tets[other, order], beyond[other, order]
            done[other] = True
            heap.append(other)


def _joined(points: Array, tets: Indices, beyond: Indices, thickness: Array) -> tuple[Indices, Array, Array]:
    """Joins tetrahedra of one sphere, from the thickest on: each one's cell, the cells' centres and powers."""
    cell = np.full(len(tets), -1, dtype=np.intp)
    centres: list[Array] = []
    powers: list[Array] = []
    for seed in np.argsort(-thickness):
        if cell[seed] >= 0:
            continue
        a = points[tets[seed, 0]]
        edges = points[tets[seed, 1:]] - a
        out = np.linalg.solve(edges, 0.5 * (edges * edges).sum(1))
        # From a corner on: radii may be millions of sizes, where the hull is nearly flat.
        away = points - a
        power = (away * away).sum(1) - 2.0 * (away @ out)
        on = np.abs(power) < max(_ON_SPHERE[0], _ON_SPHERE[1] * float(np.linalg.norm(out)))
        cell[seed] = len(centres)
        heap = [seed]
        while heap:
            for other in beyond[heap.pop()]:
                if other >= 0 and cell[other] < 0 and on[tets[other]].all():
                    cell[other] = len(centres)
                    heap.append(other)
        power[tets[cell == len(centres)]] = 0.0
        centres.append(a + out)
        powers.append(power)
    return cell, np.array(centres), np.array(powers).T


def _planes(points: Array, facets: Indices, beyond: Indices) -> tuple[Indices, Array]:
    """Returns each facet's plane and unit normal, outwards.

    Near a plane in which several hull facets lie the new cell is long; how far its corners over these facets lie apart
    is a small difference of large heights. So they have one plane.
    """
    a, b, c = (points[facets[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    areas = np.linalg.norm(cross, axis=1)
    normals: Array = cross / areas[:, None]
    plane = np.arange(len(facets))
    left = (beyond < 0).nonzero()[0]
    while len(left):
        seed = left[int(areas[left].argmax())]
        over = np.abs((points[facets[left]] - a[seed]) @ normals[seed]).max(axis=1)
        same = left[(over < _IN_PLANE) & (normals[left] @ normals[seed] > 0.0)]
        normals[same], plane[same] = normals[seed], seed
        left = np.setdiff1d(left, [*same, seed])
    return plane, normals


def _almost_flat(c: Cells) -> bool:
    """Whether two hull facets lie in one plane but for less than can be told."""
    hull = (c.beyond < 0).nonzero()[0]
    normals, corners = c.normals[hull], c.points[c.facets[hull]]
    base = np.einsum("gk,gk->g", normals, c.points[c.facets[c.plane[hull], 0]])
    over = np.abs(np.einsum("hik,gk->hgi", corners, normals) - base[:, None]).max(axis=2)
    level = (over < _ALMOST) & (normals @ normals.T > 0.0)
    return bool((level & (c.plane[hull][:, None] != c.plane[hull])).any())


def _closed(c: Cells) -> bool:
    """Whether the facets of each cell close it, the cells fill the hull, and no sphere contains a site."""
    corners = c.points[c.facets]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    gaps = np.zeros((len(c.centres), 3))
    np.add.at(gaps, c.owner, areas)
    volumes = np.einsum("fk,fk->f", areas, corners[:, 0]) / 3.0
    gap = volumes.sum() - volumes[c.beyond < 0].sum()
    return bool(
        np.abs(gaps).max() < 1e-9
        and abs(gap) < 1e-9
        and np.bincount(c.owner, volumes).min() > 0.0
        and c.powers.min() > -1e-9
    )
