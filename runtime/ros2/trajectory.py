"""A trajectory_msgs/msg/JointTrajectory as positions over time, by the rules of ros2_control's trajectory controller.

Between two points a joint moves linearly where positions alone are given, by a cubic where both have velocities, by a
quintic where both have accelerations, too. Source: ros2_controllers, joint_trajectory_controller, "Trajectory
Representation".
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array

LONGEST = 600.0  # s
MOST_POINTS = 2000
NEAR = 0.05  # rad or m, from where the joints are to a first point at 0 s
AT_REST = 1.2e-7  # rad/s or m/s, ros2_control's bound: planners round to it


class Trajectory:
    """Positions (n,) from 0 to `end` s, in the order of `names`.

    It begins at rest where the joints are; a first point at 0 s must say the same, and its velocity doesn't count.
    """

    def __init__(
        self, message: dict[str, Any], names: Sequence[str], start: Array, place: str, partial: bool = False
    ) -> None:  # fmt: skip
        """
        Args:
            message: the decoded message.
            names: of the joints; the message names the same ones, in any order.
            start: (n,) rad or m, where they are now, at rest.
            place: for the error.
            partial: whether the message may leave joints out, which then stay where they are.
        Raises:
            RequestError: it can't be followed.
        """
        given = list(message["joint_names"])
        fits = len(set(given)) == len(given) > 0 and set(given) <= set(names)
        if not fits or (len(given) != len(names) and not partial):
            remedy = f"Name {'some' if partial else 'all'} of {', '.join(names)}"
            raise RequestError(place, f"it is for {', '.join(given) or 'no joint'}", remedy)
        points = message["points"]
        if not 0 < len(points) <= MOST_POINTS:
            raise RequestError(place, f"it has {len(points)} points", f"Send 1 to {MOST_POINTS}")
        order, n, count = [names.index(name) for name in given], len(names), len(given)
        at_rest = [np.asarray(start, float), np.zeros(n), np.zeros(n)]
        times, rows, degrees = [0.0], [at_rest], [5]  # the degree that a point's own values allow
        for i, point in enumerate(points):
            time = point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]
            values = [np.asarray(point[what], float) for what in ("positions", "velocities", "accelerations")]
            if len(values[0]) != count or any(len(v) not in (0, count) for v in values[1:]):
                problem = f"point {i + 1} hasn't {count} positions"
                raise RequestError(place, problem, "Give each joint one, or none at all")
            if len(point["effort"]):
                raise RequestError(place, f"point {i + 1} has efforts", "Leave effort empty: positions are sent")
            if not all(np.isfinite(v).all() for v in values):
                raise RequestError(place, f"point {i + 1} has a number that isn't finite", "Send finite numbers")
            if not times[-1] < time <= LONGEST and not (i == 0 and time == 0.0):
                problem = f"the time of point {i + 1} is {time:g} s"
                raise RequestError(place, problem, "Let times rise, to 600 s at most")
            degree = 1 if not len(values[1]) else 3 if not len(values[2]) else 5
            row = [rest.copy() for rest in at_rest]
            for target, v in zip(row, values, strict=True):
                if len(v):
                    target[order] = v
            if time > 0.0:
                times.append(time)
                rows.append(row)
                degrees.append(degree)
            elif not np.abs(row[0] - start).max() <= NEAR:
                remedy = "Plan it from where they are, or leave point 1 out"
                raise RequestError(place, "it begins where the joints aren't", remedy)
            else:
                degrees[0] = degree
        if len(times) == 1:
            raise RequestError(place, "it has no point after its beginning", "Give a point a time above 0")
        if np.abs(rows[-1][1]).max() > AT_REST:
            raise RequestError(place, "it doesn't end at rest", "Give the last point the velocity 0")
        self.end, self._last = times[-1], rows[-1][0]
        self._times, self._spans = np.array(times), np.diff(times)
        q, v, a = (np.array([row[k] for row in rows]) for k in range(3))
        self._c = _polynomials(q, v, a, self._spans[:, None], np.minimum(degrees[1:], degrees[:-1]))

    def at(self, time: float) -> tuple[Array, Array]:
        """Position and velocity (n,) at `time` s; the last point from `end` on."""
        if time >= self.end:
            return self._last, np.zeros_like(self._last)
        i = self.index(time)
        s, T = (max(time, 0.0) - self._times[i]) / self._spans[i], self._spans[i]
        powers = s ** np.arange(6)
        slopes = np.arange(1, 6) * powers[:5]
        return self._c[i] @ powers, self._c[i][:, 1:] @ slopes / T

    def index(self, time: float) -> int:
        """Of the segment at `time` s, from 0."""
        return min(max(int(np.searchsorted(self._times, time, "right")) - 1, 0), len(self._spans) - 1)

    def check(self, lower: Array, upper: Array, velocity: Array, names: Sequence[str], place: str) -> None:
        """Raises RequestError where it leaves these limits, (n,), at any instant.

        A polynomial lies within its Bernstein coefficients; where those leave the limits, its own extrema count.
        """
        rates = self._c[..., 1:] * np.arange(1, 6) / self._spans[:, None, None]
        for what, c, least, most in (
            ("its position limits", self._c, lower, upper), ("its velocity limit", rates, -velocity, velocity),
        ):  # fmt: skip
            low, high = least - 1e-6, most + 1e-6
            hull = c @ _bernstein(c.shape[2] - 1).T
            inside = ((hull >= low[:, None]) & (hull <= high[:, None])).all(axis=2)
            for i, j in np.argwhere(~inside):
                lowest, highest = _extrema(c[i, j])
                if not (lowest >= low[j] and highest <= high[j]):
                    problem = f"between {self._times[i]:.2f} and {self._times[i + 1]:.2f} s '{names[j]}' leaves {what}"
                    raise RequestError(place, problem, "Plan within the guard's limits, or slower")


def _polynomials(q: Array, v: Array, a: Array, T: Array, degree: NDArray[np.int_]) -> Array:
    """(segments, n, 6): the coefficients of s^k, with s from 0 to 1 in each segment, of T (segments, 1) s.

    `degree`: (segments,) 1, 3 or 5.
    """
    h, v0, v1, a0, a1 = q[1:] - q[:-1], T * v[:-1], T * v[1:], T * T * a[:-1], T * T * a[1:]
    none = np.zeros_like(h)
    linear = [q[:-1], h, none, none, none, none]
    cubic = [q[:-1], v0, 3 * h - 2 * v0 - v1, v0 + v1 - 2 * h, none, none]
    quintic = [
        q[:-1], v0, 0.5 * a0, 10 * h - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1,
        -15 * h + 8 * v0 + 7 * v1 + 1.5 * a0 - a1, 6 * h - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1,
    ]  # fmt: skip
    made = [np.stack(columns, axis=2) for columns in (linear, cubic, quintic)]
    return np.stack(made)[(degree - 1) // 2, np.arange(len(degree))]


def _bernstein(degree: int) -> Array:
    """(d + 1, d + 1): from a polynomial's coefficients to those in Bernstein's basis, on 0 to 1."""
    return np.array([[comb(i, k) / comb(degree, k) if k <= i else 0.0 for k in range(degree + 1)]
                     for i in range(degree + 1)])  # fmt: skip


def _extrema(c: Array) -> tuple[float, float]:
    """The least and greatest value of sum c_k s^k for s from 0 to 1; NaN where numbers overflow."""
    slope = np.trim_zeros(c[1:] * np.arange(1, len(c)), "b")
    if not np.isfinite(slope).all():
        return np.nan, np.nan
    roots = np.polynomial.polynomial.polyroots(slope) if len(slope) > 1 else np.empty(0)
    real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)]
    values = np.polynomial.polynomial.polyval(np.concatenate([[0.0, 1.0], real]), c)
    return float(values.min()), float(values.max())
