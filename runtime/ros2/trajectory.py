"""A trajectory_msgs/msg/JointTrajectory as positions over time, by the rules of ros2_control's trajectory controller.

Between two points a joint moves linearly where positions alone are given, by a cubic with velocities, by a quintic with
accelerations, too. Source: ros2_controllers, joint_trajectory_controller, "Trajectory Representation".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array

CHECKED = 0.005  # s between two looks at the limits
LONGEST = 600.0  # s
MOST_POINTS = 10_000


class Trajectory:
    """Positions (n,) from 0 to `end` s, in the order of `names`."""

    def __init__(self, message: dict[str, Any], names: Sequence[str], start: Array, place: str) -> None:
        """
        Args:
            message: the decoded message.
            names: of the joints; the message names the same ones, in any order.
            start: (n,) rad or m, where they are now, at rest.
            place: for the error.
        Raises:
            RequestError: it can't be followed.
        """
        given = list(message["joint_names"])
        if sorted(given) != sorted(names):
            raise RequestError(place, f"it is for {', '.join(given) or 'no joint'}", f"Name all of {', '.join(names)}")
        points = message["points"]
        if not 0 < len(points) <= MOST_POINTS:
            raise RequestError(place, f"it has {len(points)} points", f"Send 1 to {MOST_POINTS}")
        order, n = [given.index(name) for name in names], len(names)
        times, rows = [0.0], [[np.asarray(start, float), np.zeros(n), np.zeros(n)]]
        degree = 5
        for i, point in enumerate(points):
            time = point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]
            values = [np.asarray(point[what], float) for what in ("positions", "velocities", "accelerations")]
            if len(values[0]) != n or any(len(v) not in (0, n) for v in values[1:]):
                raise RequestError(place, f"point {i + 1} hasn't {n} positions", "Give each joint one, or none at all")
            if not all(np.isfinite(v).all() for v in values):
                raise RequestError(place, f"point {i + 1} has a number that isn't finite", "Send finite numbers")
            if not times[-1] < time <= LONGEST and not (i == 0 and time == 0.0):
                problem = f"the time of point {i + 1} is {time:g} s"
                raise RequestError(place, problem, "Let times rise, to 600 s at most")
            degree = min(degree, 1 if not len(values[1]) else 3 if not len(values[2]) else 5)
            if time > times[-1]:
                times.append(time)
            else:  # a first point at 0 is where it begins
                rows.pop()
            rows.append([v[order] if len(v) else np.zeros(n) for v in values])
        if np.abs(rows[-1][1]).max() > 1e-9:
            raise RequestError(place, "it doesn't end at rest", "Give the last point the velocity 0")
        self.end = times[-1]
        self._times, self._degree = np.array(times), degree
        self._q, self._v, self._a = (np.array([row[k] for row in rows]) for k in range(3))

    def at(self, time: float) -> tuple[Array, Array]:
        """Position and velocity (n,) at `time` s; the last point from `end` on."""
        if time >= self.end or len(self._times) == 1:
            return self._q[-1], np.zeros_like(self._q[-1])
        i = max(int(np.searchsorted(self._times, time, "right")) - 1, 0)
        T = self._times[i + 1] - self._times[i]
        s, h = (max(time, 0.0) - self._times[i]) / T, self._q[i + 1] - self._q[i]
        if self._degree == 1:
            return self._q[i] + s * h, h / T
        v0, v1 = T * self._v[i], T * self._v[i + 1]
        if self._degree == 3:
            c2, c3 = 3 * h - 2 * v0 - v1, v0 + v1 - 2 * h
            return self._q[i] + s * (v0 + s * (c2 + s * c3)), (v0 + s * (2 * c2 + s * 3 * c3)) / T
        a0, a1 = T * T * self._a[i], T * T * self._a[i + 1]
        c3 = 10 * h - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
        c4 = -15 * h + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
        c5 = 6 * h - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1
        q = self._q[i] + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        return q, (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / T

    def check(self, lower: Array, upper: Array, velocity: Array, names: Sequence[str], place: str) -> None:
        """Raises RequestError where it leaves these limits, (n,): they are looked at every CHECKED s."""
        for time in np.arange(0.0, self.end + CHECKED, CHECKED):
            q, dq = self.at(min(float(time), self.end - 1e-9))
            for what, wrong in (
                ("its position limits", (q < lower - 1e-6) | (q > upper + 1e-6)),
                ("its velocity limit", np.abs(dq) > velocity * (1 + 1e-6)),
            ):
                if wrong.any():
                    name = names[int(wrong.argmax())]
                    raise RequestError(
                        place, f"at {time:.2f} s '{name}' leaves {what}", "Plan within the guard's limits, or slower"
                    )
