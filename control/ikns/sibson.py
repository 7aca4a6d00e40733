"""Natural-neighbour (Sibson) coordinates in three dimensions, one query a cycle.

Sibson, A brief description of natural neighbour interpolation, 1981. A point x steals from each site i the volume
vol_i of its Voronoi cell; the weights are w_i = vol_i / sum vol. They are not negative, sum to 1, and reproduce x:
sum w_i x_i = x.

How the volumes are found. Delaunay cells whose circumsphere contains x make up the cavity. Inserting x replaces them by
the tetrahedra S = (x, F) over the cavity's boundary facets F. A tetrahedron T with circumcentre g gives its vertex i
the signed volume

    D(i, T) = 1/6 sum over facets f of T at i: rho_f A_f (1 - b_i),

with rho_f the height of g over f (inwards), A_f the facet's area, b_i the barycentric coordinate of i at f's own
circumcentre. Then vol_i = sum_cavity D(i, T) - sum_S D(i, S). The first sum is known at construction. The circumcentre
of S lies on the normal of F through the cell's g, at t = p / (2 d), p the power of x to the cell's sphere and d its
height over F. An inner facet in whose plane x lies is never one of the boundary, so no quotient fails there, as it does
in Watson's sum over all the cavity's facets. Sites on one sphere are one cell, and so have no inner facets at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.control.ikns.delaunay import Cells, delaunay
from srl.runtime.contracts.signals import Array

_TIE: Final = 1e-14  # of the size squared: x on a circumsphere; such a cell steals nothing
_AT_SITE: Final = 1e-13  # of the size: nearer than this x is the site
_NEAR: Final = 1e-12  # of the size: nearer than this to a facet's plane x is in it

_DEPTH: Final = 1e-10  # of the size: x on the hull is taken this deep in it; the cell of a point on it is unbounded

_XYZXY: Final = np.array([0, 1, 2, 0, 1])
_sum: Final = np.add.reduce  # over the first axis; the method costs a microsecond more


@dataclass(frozen=True)
class Nearest:
    """The point of the convex hull nearest to a query: (3,) m, and how far it is, m; 0 inside."""

    point: Array
    distance: float


class Sibson:
    """Sibson weights among N sites. Outside their convex hull: those of its nearest point, so they are continuous.

    Attributes:
        sites: (N, 3) m.
    """

    def __init__(self, sites: Array) -> None:
        """Args: sites (N, 3) m. Raises SitesError for sites that span no volume."""
        self.sites = np.array(sites, dtype=float)
        self._cells = c = delaunay(self.sites)
        n = len(c.points)
        self._x = c.points
        self._xyzxy = np.ascontiguousarray(c.points[:, _XYZXY].T)  # cross products are products of its slices
        self._twice_g = 2.0 * c.centres
        self._power0 = np.ascontiguousarray(c.powers)
        self._height0 = _heights(c)
        self._owner, self._beyond = c.owner, np.where(c.beyond < 0, len(c.centres), c.beyond)
        self._cavity = np.zeros(len(c.centres) + 1, dtype=bool)  # the last one is what lies outside the hull
        centres = c.centres[c.owner]
        rho = -np.einsum("fk,fk->f", c.normals, centres - c.points[c.facets[:, 0]])
        share = _shares(c)
        # Columns of facets: normal, circumcentre of the owner, rho, A (1 - b_i) / 6.
        self._numbers = np.vstack([c.normals.T, centres.T, rho, share])
        # Corners of the facet, then of its sides: the side opposite each corner begins and ends at the other two.
        corners = c.facets.T
        self._corners = np.vstack([corners, corners[[1, 2, 0]], corners[[2, 0, 1]]])
        self._inner = np.zeros((len(c.centres), n))  # what each cell gives its sites
        np.add.at(self._inner, (c.owner[None, :], corners), rho * share)
        self._hull = _Hull(c)

    def weights(self, x: Array) -> Array:
        """Returns (N,) weights at x (3,) m. They aren't all finite where x isn't."""
        return self._at(self._hull.inside((x - self._cells.origin) / self._cells.size))

    def nearest(self, x: Array) -> Nearest:
        """Returns the hull's point nearest to x (3,) m."""
        y = (x - self._cells.origin) / self._cells.size
        point = self._hull.nearest(y)
        if point is y:
            return Nearest(np.array(x, dtype=float), 0.0)
        distance = self._cells.size * float(np.linalg.norm(point - y))
        return Nearest(self._cells.origin + self._cells.size * point, distance)

    def _at(self, y: Array) -> Array:
        """Weights at a point in the hull, in the cells' own coordinates."""
        n = len(self._x)
        away = self._xyzxy - y.take(_XYZXY)[:, None]
        q = _sum(away[:3] * away[:3])
        s = int(q.argmin())
        qs = q[s]
        if not qs > _AT_SITE**2:  # or not a number
            w = np.zeros(n)
            w[s] = 1.0 if qs <= _AT_SITE**2 else np.nan
            return w
        # Powers and heights are taken from the nearest site on: they keep their digits near it.
        z = y - self._x[s]
        power = self._power0[s] - self._twice_g.dot(z)
        power += qs + 2.0 * z.dot(self._x[s])
        cavity = self._cavity
        np.less(power, -_TIE, out=cavity[:-1])
        f = (cavity.take(self._owner) > cavity.take(self._beyond)).nonzero()[0]
        numbers, sites = self._numbers.take(f, axis=1), self._corners.take(f, axis=1)
        normals = numbers[:3]
        # Element by element, as a product of matrices doesn't promise the same bits for facets in one plane.
        height = _sum(z[:, None] * normals) + self._height0[s].take(f)
        t = 0.5 * power.take(self._owner.take(f)) / height
        g = numbers[3:6] + t * normals - y[:, None]
        ends = sites[3:]
        sides = away.take(ends, axis=1)  # (x y z x y, two ends of three sides, B)
        a, b = sides[:, :3], sides[:, 3:]
        normal = a[1:4] * b[2:] - a[2:] * b[1:4]
        side = _sum(g[:, None] * normal) / 12.0
        squares = q.take(ends)
        per = 0.5 * side / _sum(normal * normal)
        ab = _sum(a[:3] * b[:3])
        aa, bb = squares[:3], squares[3:]
        gone = np.empty((3, 3, len(f)))
        gone[0] = (numbers[6] - t) * numbers[7:]
        gone[1] = side - per * bb * (aa - ab)
        gone[2] = side - per * aa * (bb - ab)
        stolen = _sum(self._inner.take(cavity[:-1].nonzero()[0], axis=0))
        stolen -= np.bincount(sites.ravel(), gone.ravel(), n)
        np.maximum(stolen, 0.0, out=stolen)
        stolen /= _sum(stolen)
        return stolen


class _Hull:
    """The convex hull of the sites: nearest point, and how far inside a point is."""

    def __init__(self, c: Cells) -> None:
        outer = c.beyond < 0
        corners = c.points[c.facets[outer]]  # (H, 3, 3)
        self._normals, self._a = c.normals[outer], corners[:, 0]
        self._offsets = np.einsum("hk,hk->h", self._normals, c.points[c.facets[c.plane[outer], 0]])
        self._centre = c.points.mean(axis=0)
        self._depth = self._offsets - self._normals.dot(self._centre)
        pairs = np.sort(c.facets[outer][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        pairs = np.unique(pairs, axis=0)
        self._from, to = c.points[pairs[:, 0]], c.points[pairs[:, 1]]
        self._along = to - self._from
        self._per = self._along / np.einsum("ek,ek->e", self._along, self._along)[:, None]
        e1, e2 = corners[:, 1] - self._a, corners[:, 2] - self._a
        self._dual = np.stack([np.linalg.pinv(np.stack(e, axis=1)) for e in zip(e1, e2, strict=True)])

    def nearest(self, y: Array) -> Array:
        """Returns y itself if it is inside or on it, else the nearest point of the hull."""
        over = self._normals.dot(y) - self._offsets
        return self._nearest(y, over) if over.max() > _NEAR else y

    def inside(self, y: Array) -> Array:
        """Returns y, or if it is outside the nearest point, drawn towards the centre until it is `_DEPTH` inside."""
        over = self._normals.dot(y) - self._offsets
        most = over.max()
        if most <= -_DEPTH:
            return y
        if most > _NEAR:
            y = self._nearest(y, over)
            over = self._normals.dot(y) - self._offsets
        lacking = np.maximum(_DEPTH + over, 0.0)
        share = (lacking / (self._depth - _DEPTH + lacking)).max()
        return y + share * (self._centre - y)

    def _nearest(self, y: Array, over: Array) -> Array:
        # It lies on an edge, or in a facet over which y is.
        t = ((y - self._from) * self._per).sum(1).clip(0.0, 1.0)
        points = self._from + t[:, None] * self._along
        squares = ((points - y) ** 2).sum(1)
        k = int(squares.argmin())
        point, best = points[k], squares[k]
        for h in (over > -_NEAR).nonzero()[0]:
            if over[h] ** 2 < best:
                foot = y - over[h] * self._normals[h]
                u, v = self._dual[h].dot(foot - self._a[h])
                if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
                    point, best = foot, over[h] ** 2
        return point


def _heights(c: Cells) -> Array:
    """(N, F): height of each site over each facet; exactly 0 for those that span it."""
    heights: Array = c.points @ c.normals.T - np.einsum("fk,fk->f", c.normals, c.points[c.facets[:, 0]])
    heights[c.facets.T, c.plane] = 0.0
    return heights[:, c.plane]  # facets in one plane have the same heights to the bit


def _shares(c: Cells) -> Array:
    """(3, F): A (1 - b_i) / 6 of each facet's corners."""
    corners = c.points[c.facets]
    edges = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)  # edge opposite each corner
    l2 = np.einsum("fik,fik->fi", edges, edges)
    area2 = (np.cross(edges[:, 0], edges[:, 1]) ** 2).sum(1)  # (2 A)^2
    b = l2 * (l2.sum(1, keepdims=True) - 2.0 * l2) / (4.0 * area2[:, None])
    shares: Array = np.sqrt(area2)[:, None] * (1.0 - b) / 12.0
    return np.ascontiguousarray(shares.T)
