"""The minimum enclosing sphere of a few points, exact and without random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import sqrt

Point = Sequence[float]

_INSIDE = 1e-11  # relative to r^2, tolerance within which a point counts as inside a candidate
_FLAT = 1e-14  # relative determinant below which points lie on a line or plane, or coincide


class MinimumSphere:
    """The smallest sphere around points that move little from one call to the next.

    The last support is tried first. The sphere on it is the smallest around all points if it contains them and
    its centre lies in the support's hull. Otherwise a new search begins.
    """

    def __init__(self) -> None:
        self.support: list[int] = []

    def reset(self) -> None:
        """Forgets the last support."""
        self.support = []

    def around(self, cloud: list[Point]) -> tuple[float, float, float, float]:
        """Centre x, y, z and radius r, m, of the smallest sphere around points (n, 3), n >= 1.

        Each call must have as many points in the same order.
        """
        if self.support:
            p, *others = [cloud[i] for i in self.support]
            found = _circumcentre(p, tuple(others))
            if found is not None and found[1]:
                centre = found[0]
                reach2 = _farthest(cloud, centre)[1]
                if reach2 <= _distance2(p, centre) * (1.0 + _INSIDE):
                    return centre[0], centre[1], centre[2], sqrt(reach2)
        centre, radius, support = _search(cloud)
        self.support = [cloud.index(p) for p in support]
        return centre[0], centre[1], centre[2], radius


def _search(cloud: list[Point]) -> tuple[Point, float, list[Point]]:
    """Searches for centre, radius and support.

    The support (at most four points, all on the surface) takes in the farthest point until no point is outside.
    The radius grows with every step, so the search ends. r is the farthest point's distance, so no point is outside.
    """
    first, _ = _farthest(cloud, cloud[0])
    second, d2 = _farthest(cloud, first)
    support, r2 = [first, second], 0.25 * d2
    centre: Point = [0.5 * (a + b) for a, b in zip(first, second, strict=True)]
    farthest, reach2 = _farthest(cloud, centre)
    while reach2 > r2 * (1.0 + _INSIDE):
        grown, grown2, next_support = _smallest(support, farthest)
        if grown2 <= r2:  # only rounding is left
            break
        point, far2 = _farthest(cloud, grown)
        centre, r2, support, farthest, reach2 = grown, grown2, next_support, point, far2
    return centre, sqrt(reach2), support


def _farthest(cloud: list[Point], centre: Point) -> tuple[Point, float]:
    best, most = cloud[0], -1.0
    for p in cloud:
        d2 = _distance2(p, centre)
        if d2 > most:
            best, most = p, d2
    return best, most


def _distance2(p: Point, q: Point) -> float:
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    return x * x + y * y + z * z


def _smallest(support: list[Point], p: Point) -> tuple[Point, float, list[Point]]:
    """The smallest sphere around `support` and p, with p on its surface, and the points that support it."""
    best: tuple[Point, float, list[Point]] = (p, 0.0, [p])
    least = float("inf")
    for q in support:  # a sphere on two points that contains all is the smallest
        centre: Point = [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])]
        r2 = _distance2(p, centre)
        if _farthest(support, centre)[1] <= r2 * (1.0 + _INSIDE):
            return centre, r2, [p, q]
    for size in range(2, min(len(support), 3) + 1):
        for chosen in combinations(support, size):
            through = _circumcentre(p, chosen)
            if through is None:
                continue
            centre = through[0]
            r2 = _distance2(p, centre)
            if r2 < least and _farthest(support, centre)[1] <= r2 * (1.0 + _INSIDE):
                best, least = (centre, r2, [p, *chosen]), r2
    return best


def _circumcentre(p: Point, others: tuple[Point, ...]) -> tuple[Point, bool] | None:
    """The point of the affine hull as far from p as from up to three others; None if they are flat.

    Also returns whether it lies in their convex hull, so that no smaller sphere contains them.

    With edges e_i = p_i - p, the point is p + sum w_i e_i, where sum_j (e_i . e_j) w_j = e_i . e_i / 2.
    """
    px, py, pz = p
    edges = [(q[0] - px, q[1] - py, q[2] - pz) for q in others]
    g = [[a[0] * b[0] + a[1] * b[1] + a[2] * b[2] for b in edges] for a in edges]
    if len(edges) < 2:
        w = [0.5] * len(edges)
    elif len(edges) == 2:
        (A, B), (_, C) = g
        det = A * C - B * B
        if det <= _FLAT * A * C:
            return None
        w = [0.5 * C * (A - B) / det, 0.5 * A * (C - B) / det]
    else:
        (A, B, C), (_, D, E), (_, _, F) = g
        a, b, c = D * F - E * E, C * E - B * F, B * E - C * D  # first row of the adjugate
        det = A * a + B * b + C * c
        if det <= _FLAT * A * D * F:
            return None
        d, e, f = A * F - C * C, B * C - A * E, A * D - B * B
        w = [
            0.5 * (a * A + b * D + c * F) / det,
            0.5 * (b * A + d * D + e * F) / det,
            0.5 * (c * A + e * D + f * F) / det,
        ]
    (x, y, z), total = p, 0.0
    for k, (ex, ey, ez) in zip(w, edges, strict=True):
        total += k  # `sum` rounds otherwise from Python 3.12 on
        x, y, z = x + k * ex, y + k * ey, z + k * ez
    return [x, y, z], min(w, default=0.0) >= 0.0 and total <= 1.0
