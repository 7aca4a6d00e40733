"""Curves along which a simulated person moves a tool, by arc length."""

from __future__ import annotations

from bisect import bisect_right
from math import pi
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.rotation import Quaternion, Vector, exp, normalised, product
from srl.runtime.contracts.signals import Array
from srl.sim.wearer.motion import Curve
from srl.sim.wearer.tables import read_rows

_SPACING: Final = 0.002  # m between the points of the table
_SMOOTH: Final = 0.02  # m to either side, over which a direction is meant: nobody turns a tool with every wrinkle
Pose = tuple[float, float, float, float, float, float, float]  # x, y, z, m; w, x, y, z


class ArcPath:
    """A smooth curve through points, as poses over its length.

    With `turning`, the orientation is transported along the curve without twist (parallel transport), starting with
    `start`. Otherwise the orientation stays `start`.

    Attributes:
        length: m.
    """

    def __init__(self, points: Array, start: Quaternion, *, turning: bool) -> None:
        """Args: points (n, 3), m, n >= 2, not all in one place."""
        apart = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])
        points = points[apart]
        if len(points) < 2:
            raise ValueError("a curve needs two points that are apart")
        chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        fine = Curve(chord, points).at(np.linspace(0.0, chord[-1], 4 * max(int(chord[-1] / _SPACING), 8) + 1))
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
        # Evenly along the curve: its own parameter slows down at corners.
        even = np.linspace(0.0, way[-1], max(int(way[-1] / _SPACING), 8) + 1)
        table = np.stack([np.interp(even, way, fine[:, k]) for k in range(3)], axis=1)
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(table, axis=0), axis=1))])
        self._arc: list[float] = arc.tolist()
        self._points: list[list[float]] = table.tolist()
        self.length = self._arc[-1]
        self._turns = [start] * len(table)
        along = _directions(table, arc)
        angles = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1.0, 1.0))
        self._bends: list[float] = (angles / np.maximum(np.diff(arc), 1e-9)).tolist()
        if turning:
            for i in range(1, len(table)):
                axis = np.cross(along[i - 1], along[i])
                sine = float(np.linalg.norm(axis))
                angle = float(np.arctan2(sine, along[i - 1] @ along[i]))
                x, y, z = (axis * (angle / sine) if sine > 1e-12 else np.zeros(3)).tolist()
                self._turns[i] = normalised(product(exp(x, y, z), self._turns[i - 1]))

    def at(self, s: float) -> Pose:
        """The pose at distance s, m, from the beginning; outside the curve, the pose of the nearer end."""
        arc = self._arc
        i = min(max(bisect_right(arc, s) - 1, 0), len(arc) - 2)
        u = min(max((s - arc[i]) / (arc[i + 1] - arc[i]), 0.0), 1.0)
        (a, b, c), (d, e, f) = self._points[i], self._points[i + 1]
        p, q = self._turns[i], self._turns[i + 1]
        w, x, y, z = normalised(
            (p[0] + u * (q[0] - p[0]), p[1] + u * (q[1] - p[1]), p[2] + u * (q[2] - p[2]), p[3] + u * (q[3] - p[3]))
        )
        return (a + u * (d - a), b + u * (e - b), c + u * (f - c), w, x, y, z)

    def bend(self, a: float, b: float) -> float:
        """How sharply the curve turns at most between the distances a and b, m, in either order: rad/m."""
        i, j = sorted(min(max(bisect_right(self._arc, s) - 1, 0), len(self._bends) - 1) for s in (a, b))
        return max(self._bends[i : j + 1])


def _directions(table: Array, arc: Array) -> Array:
    """(n, 3) unit vectors along a curve, smooth enough that what turns with it turns without jerks."""
    along = np.gradient(table, arc, axis=0)
    reach = min(max(round(_SMOOTH * (len(arc) - 1) / arc[-1]), 1), len(arc) - 1)
    weights = np.hanning(2 * reach + 3)[1:-1]
    padded = np.pad(along, ((reach, reach), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(padded[:, k], weights / weights.sum(), "valid") for k in range(3)], axis=1)
    found: Array = smooth / np.linalg.norm(smooth, axis=1, keepdims=True)
    return found


def circle(centre_side: Vector, radius: float) -> Array:
    """(65, 3): one turn in the x-y plane, starting at the given point; the centre is on its -x side."""
    angle = np.linspace(0.0, 2 * pi, 65)
    round_ = np.stack([np.cos(angle) - 1.0, np.sin(angle), np.zeros(65)], axis=1)
    return np.array(centre_side) + radius * round_


def read_path(file: Path) -> Array:
    """(n, 3), m: the columns x, y, z of a CSV with a header.

    Raises:
        RecordingError: no such file, no such columns, not numbers, fewer than two rows.
    """
    if not file.exists():
        raise RecordingError(str(file), "there is no such file", "Check the step's 'file'")
    header, rows, first = read_rows(file)
    try:
        columns = [header.index(name) for name in ("x", "y", "z")]
    except ValueError as error:
        raise RecordingError(
            f"{file}, line 1", f"the header is '{', '.join(header)[:100]}'", "Name columns x, y, z, in m"
        ) from error
    try:
        points = np.array([[float(row[i]) for i in columns] for row in rows]).reshape(-1, 3)
    except ValueError as error:
        raise RecordingError(f"{file}, from line {first} on", str(error), "Give numbers, in m") from error
    if len(points) < 2 or not np.isfinite(points).all():
        raise RecordingError(str(file), f"it has {len(points)} point(s)", "Give two at least, all finite")
    return points
