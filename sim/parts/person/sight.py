"""What a simulated person sees of the tool, with delay and bandwidth, and the correction made from it."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, pi

from srl.runtime.contracts.rotation import Vector
from srl.sim.parts.person.path import Pose

_REACH = 0.25  # m and rad, greatest correction by sight
_POSE, _ERROR = 7, 6

Error = tuple[float, ...]
"""(6,) m and rad: where the tool is meant to be, less where it is."""


class Sight:
    """Stores the tool's pose and error until the person sees them, and accumulates the correction."""

    def __init__(self, delay: float, bandwidth: float, correction: tuple[float, float], dt: float) -> None:
        """Args:
        delay: s.
        bandwidth: Hz.
        correction: share of the seen error corrected at once, and share a second.
        dt: s between two instants.
        """
        self._dt, self._correction = dt, correction
        self._slow = 1.0 - exp(-dt * 2 * pi * bandwidth)
        self._rows: list[tuple[float, ...]] = [(0.0,) * (_POSE + _ERROR)] * max(1, round(delay / dt))  # a ring buffer
        self._filtered: tuple[float, ...] = (0.0,) * (2 * _ERROR)  # the seen error, filtered in two stages
        self._shift: Error = (0.0,) * _ERROR  # the accumulated correction

    def begin(self, tool: Pose) -> None:
        """Starts with the tool's present pose and no error."""
        self._rows = [(*tool, *(0.0,) * _ERROR)] * len(self._rows)

    def seen(self, number: int) -> tuple[Pose, Error]:
        """The tool's pose and error that the person sees at update `number`, i.e. the delayed ones."""
        row = self._rows[number % len(self._rows)]
        return row[:_POSE], row[_POSE:]  # type: ignore[return-value]

    def take(self, number: int, tool: Pose, error: Error) -> None:
        """Stores the pose and error at update `number`; call `seen` first."""
        self._rows[number % len(self._rows)] = (*tool, *error)

    def correction(self, off: Error, along: Vector | None) -> Error:
        """The correction of the hand's position, m and rad (6,), from the seen error.

        Args:
            along: a direction in which the person pushes; no correction is made along it.
        """
        if along is not None:
            way = off[0] * along[0] + off[1] * along[1] + off[2] * along[2]
            off = (off[0] - way * along[0], off[1] - way * along[1], off[2] - way * along[2], *off[3:])
        k, (at_once, by_time) = self._slow, self._correction
        gain, filtered = by_time * self._dt, self._filtered
        first, second, shift, out = [], [], [], []
        for i, (now, a, b, s) in enumerate(zip(off, filtered[:_ERROR], filtered[_ERROR:], self._shift, strict=True)):
            once = a + k * (now - a)
            twice = b + k * (once - b)
            late = twice if i < 3 else twice / 3
            summed = s + gain * late
            summed = -_REACH if summed < -_REACH else _REACH if summed > _REACH else summed
            first.append(once)
            second.append(twice)
            shift.append(summed)
            out.append(at_once * late + summed)
        self._filtered, self._shift = (*first, *second), tuple(shift)
        return tuple(out)

    def save(self) -> list[float]:
        """Its state."""
        return [*self._filtered, *self._shift, *(value for row in self._rows for value in row)]

    def restore(self, values: Iterator[float]) -> None:
        """Restores the state returned by `save`."""
        self._filtered = tuple(next(values) for _ in self._filtered)
        self._shift = tuple(next(values) for _ in self._shift)
        self._rows = [tuple(next(values) for _ in row) for row in self._rows]
