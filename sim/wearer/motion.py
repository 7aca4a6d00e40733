"""The interface of all wearers, and motion interpolated from samples."""

from __future__ import annotations

from bisect import bisect_right
from typing import Final, Protocol, TypeVar

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import RANGES
from srl.sim.wearer.fitting import Fitted

BLEND: Final = 0.5  # s, from the end of one section of a recording to the beginning of the next
Number = TypeVar("Number", float, Array)
_RATE: Final = 100.0  # Hz of blends


class Wearer(Protocol):
    """A person's intention for the 20 joints of the hand.

    Attributes:
        duration: end of the motion, s; inf if it never ends.
        fitted: how a recording was brought into the ranges; None if the motion is none.
    """

    duration: float
    fitted: Fitted | None

    def target(self, t: float) -> Array:
        """Joint angles (20,), rad, within the hand's ranges, at t seconds since the world's start.

        The same time gives the same bits, in whatever order times are requested.
        """
        ...


class Curve:
    """A smooth curve through samples: piecewise cubic, and monotone wherever the samples are.

    So the curve never overshoots the recorded values. Slopes are the weighted harmonic means of Fritsch and Butland
    (SIAM J. Sci. Stat. Comput. 5(2), 1984), zero at an extremum and at both ends.
    """

    def __init__(self, time: Array, values: Array) -> None:
        """Args: time (n,), s, strictly increasing, n >= 2; values (n, m)."""
        h = np.diff(time)[:, None]
        slope = np.diff(values, axis=0) / h
        left, right = slope[:-1], slope[1:]
        w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
        same = left * right > 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = (w1 + w2) / (w1 / left + w2 / right)
        d = np.zeros_like(values)
        d[1:-1] = np.where(same, mean, 0.0)
        d0, d1, rise = h * d[:-1], h * d[1:], np.diff(values, axis=0)
        self._time: list[float] = time.tolist()
        # Coefficients of the cubic in s = (t - t_i) / h_i, highest power first.
        self._cubic = np.stack([d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1, d0, values[:-1]], axis=1)

    def at(self, t: Array) -> Array:
        """Values (k, m) at the times (k,); outside the samples, the nearest sample."""
        return np.array([self.at_one(float(moment)) for moment in t])

    def at_one(self, t: float) -> Array:
        """Values (m,) at one time."""
        time = self._time
        i = min(max(bisect_right(time, t) - 1, 0), len(time) - 2)
        s = min(max((t - time[i]) / (time[i + 1] - time[i]), 0.0), 1.0)
        a, b, c, d = self._cubic[i]
        return d + s * (c + s * (b + s * a))


class SampledWearer:
    """A recorded motion."""

    def __init__(
        self,
        time: Array,
        position: Array,
        *,
        ranges: Array = RANGES,
        fitted: Fitted | None = None,
        speed: float = 1.0,
        loop: bool = False,
    ) -> None:
        """Args: time (n,), s, strictly increasing; position (n, 20), rad, clipped to the ranges (20, 2), rad."""
        self.fitted = fitted
        self._lower, self._upper = np.ascontiguousarray(ranges.T)
        position = np.clip(position, self._lower, self._upper)
        if loop:
            time, position = join([(time, position), (time[:1], position[:1])])
        self._curve = Curve(time, position)
        self._start, self._span = float(time[0]), float(time[-1] - time[0])
        self._speed, self._loop = speed, loop
        self.duration = np.inf if loop else self._span / speed

    def target(self, t: float) -> Array:
        t *= self._speed
        if self._loop:
            t %= self._span
        q = self._curve.at_one(self._start + t)
        np.maximum(q, self._lower, out=q)  # rounding of a cubic can exceed the limits slightly
        return np.minimum(q, self._upper, out=q)


def join(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Joins sections of motion, (time (n,), position (n, m)), in sequence, with a blend of 0.5 s between them."""
    times, positions = [parts[0][0]], [parts[0][1]]
    s = np.arange(1, round(BLEND * _RATE)) / (BLEND * _RATE)
    for time, position in parts[1:]:
        start, end = positions[-1][-1], times[-1][-1]
        times += [end + BLEND * s, end + BLEND + (time - time[0])]
        positions += [start + minimum_jerk(s)[:, None] * (position[0] - start), position]
    return np.concatenate(times), np.concatenate(positions)


def minimum_jerk(s: Array) -> Array:
    """The covered share of a reaching movement at the fraction s of its duration (Flash and Hogan 1985)."""
    return quintic(np.minimum(np.maximum(s, 0.0), 1.0))


def quintic(s: Number) -> Number:
    """The minimum-jerk polynomial, for s from 0 to 1."""
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))
