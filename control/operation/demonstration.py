"""A task as a hand has shown it: a path with its timing, from samples that were checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

PERIOD: Final = 0.05  # s between two points of a path; what a hand does on purpose is slower (below 5 Hz)
LONGEST: Final = 60.0  # s
_SPAN: Final = 4.0  # half width of the smoothing kernel, in its standard deviations


class TaskError(SrlError):
    """A demonstration that can't be repeated."""


class Thresholds(Options):
    """What a demonstration must keep. All are ours: they bound what is worth repeating, not what people can do."""

    shortest: float = Field(1.0, gt=0.2, le=LONGEST, description="s, least duration of the motion")
    length: float = Field(0.05, gt=0.0, lt=5.0, description="m, least length of the path")
    speed: float = Field(1.2, gt=0.05, lt=5.0, description="m/s, the most; a slip or a lost sensor is faster")
    still: float = Field(0.02, ge=0.0, lt=0.2, description="m/s; what is slower at both ends is cut off")
    gap: float = Field(0.15, gt=0.0, lt=1.0, description="s, longest time without a finite sample")
    smooth: float = Field(
        0.05, gt=0.0, lt=0.5, description="s, standard deviation of the Gaussian in time that smooths the samples"
    )


@dataclass(frozen=True, eq=False)
class TaskPath:
    """A path with its timing.

    Attributes:
        points: (m, 3) m, `PERIOD` apart, m >= 2.
    """

    points: Array

    @property
    def duration(self) -> float:
        """s."""
        return (len(self.points) - 1) * PERIOD

    @property
    def length(self) -> float:
        """m, of the polyline."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def fastest(self) -> float:
        """m/s, greatest speed between two points."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).max()) / PERIOD

    def at(self, s: float) -> tuple[Array, Array]:
        """Place (3,) m and velocity (3,) m/s at s seconds of the demonstration; at rest at and beyond both ends.

        A cubic Hermite spline through the points; its velocities there are central differences, and zero at the ends.
        """
        p, last = self.points, len(self.points) - 1
        u = min(max(s / PERIOD, 0.0), float(last))
        i = min(int(u), last - 1)
        u -= i
        a, b = p[i], p[i + 1]
        va = 0.5 * (b - p[i - 1]) if i > 0 else np.zeros(3)
        vb = 0.5 * (p[i + 2] - a) if i + 1 < last else np.zeros(3)
        u2 = u * u
        way = b - a
        place = a + u * va + u2 * (3.0 * way - 2.0 * va - vb) + u2 * u * (va + vb - 2.0 * way)
        velocity = (va + 2.0 * u * (3.0 * way - 2.0 * va - vb) + 3.0 * u2 * (va + vb - 2.0 * way)) / PERIOD
        return place, velocity


def path_of(times: Array, points: Array, needed: Thresholds | None = None) -> TaskPath:
    """Makes a path of a hand's samples.

    Args:
        times: (k,) s, rising.
        points: (k, 3) m; samples that aren't finite are left out.
        needed: what it must keep.
    Raises:
        TaskError: with the reason, for one that can't be repeated.
    """
    th = needed or Thresholds()
    seen = np.isfinite(points).all(axis=1)
    if seen.sum() < 4:
        raise TaskError("demonstration", f"only {int(seen.sum())} samples of the hand", "Show the task again")
    t, p = times[seen], points[seen]
    if (gap := float(np.diff(t).max())) > th.gap:
        at = t[int(np.diff(t).argmax())] - times[0]
        problem = f"the hand wasn't seen for {gap:.2f} s, {at:.1f} s after the beginning; {th.gap} s are allowed"
        raise TaskError("demonstration", problem, "See that the suit is connected, and show it again")
    smooth = _smoothed(t, p, th.smooth)
    smooth = _moving(smooth, th.still)
    path = TaskPath(smooth)
    if path.duration < th.shortest:
        problem = f"the hand moved for {path.duration:.1f} s, {th.shortest} s are needed"
        raise TaskError("demonstration", problem, "Show it slower, or begin and end the teaching around the motion")
    if path.duration > LONGEST:
        problem = f"it lasts {path.duration:.0f} s; {LONGEST:.0f} s are the most"
        raise TaskError("demonstration", problem, "Show a shorter task; it can be repeated")
    if path.length < th.length:
        problem = f"the path is {1e3 * path.length:.0f} mm long, {1e3 * th.length:.0f} mm are needed"
        raise TaskError("demonstration", problem, "Move the hand through the whole task")
    if path.fastest > th.speed:
        at = float(np.linalg.norm(np.diff(smooth, axis=0), axis=1).argmax()) * PERIOD
        problem = f"the hand moved at {path.fastest:.1f} m/s {at:.1f} s after the beginning; {th.speed} m/s are allowed"
        raise TaskError("demonstration", problem, "Show it slower; was a sensor loose?")
    return path


def _smoothed(t: Array, p: Array, deviation: float) -> Array:
    """The samples every PERIOD, as means weighted by a Gaussian in time.

    Beyond both ends the samples go on as their point reflections, so that the ends stay where they are.
    """
    ahead, behind = t <= t[0] + _SPAN * deviation, t >= t[-1] - _SPAN * deviation
    wide_t = np.concatenate([2 * t[0] - t[ahead][:0:-1], t, 2 * t[-1] - t[behind][-2::-1]])
    wide_p = np.concatenate([2 * p[0] - p[ahead][:0:-1], p, 2 * p[-1] - p[behind][-2::-1]])
    # Samples may come at any times, so they are first taken to a fine and even time.
    fine = deviation / 10.0
    grid = np.arange(wide_t[0], wide_t[-1] + fine, fine)
    even = np.stack([np.interp(grid, wide_t, wide_p[:, i]) for i in range(3)], axis=1)
    k = np.arange(-round(_SPAN * 10), round(_SPAN * 10) + 1)
    weights = np.exp(-0.5 * (k / 10.0) ** 2)
    weights /= weights.sum()
    mean = np.stack([np.convolve(even[:, i], weights, mode="same") for i in range(3)], axis=1)
    wanted = np.arange(t[0], t[-1] + 1e-9, PERIOD)
    return np.stack([np.interp(wanted, grid, mean[:, i]) for i in range(3)], axis=1)


def _moving(p: Array, still: float) -> Array:
    """Without the rest at both ends; at least two points."""
    fast = np.flatnonzero(np.linalg.norm(np.diff(p, axis=0), axis=1) > still * PERIOD)
    if not len(fast):
        return p[:2] if len(p) > 1 else np.repeat(p, 2, axis=0)
    return p[fast[0] : fast[-1] + 2]
