"""The samples of a sensor: a ring buffer of the world's values at exact multiples of the sample period."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from srl.runtime.contracts.signals import Array


class Samples:
    """A ring buffer of samples, indexed by sample number.

    Sample k holds the values of `take` at world time k / rate, or at the first physics step after it.

    Attributes:
        taken: number of the newest sample; -1 before the first.
        start: world time of sample 0, ns.
    """

    def __init__(self, rate: Fraction, take: Callable[[], Array], size: int, kept: float = 1.0, start: int = 0) -> None:
        """
        Args:
            rate: sampling rate, Hz.
            take: returns the present true values, (size,).
            size: number of values in a sample.
            kept: how long samples are kept, s.
            start: world time of sample 0, ns.
        """
        self.taken = -1
        self.start = start
        self._take = take
        self._ns, self._per = (Fraction(10**9) / rate).as_integer_ratio()
        self._ring = np.zeros((max(int(float(rate) * kept), 1) + 2, size))

    @property
    def period(self) -> Fraction:
        """Time between samples, ns."""
        return Fraction(self._ns, self._per)

    def taken_at(self, number: int) -> int:
        """World time at which a sample is due, ns."""
        return self.start + number * self._ns // self._per

    def newest(self, at: int | None = None) -> int:
        """Number of the newest sample taken by world time `at` (ns; default: now); -1 if there is none."""
        if at is None:
            return self.taken
        return min(self.taken, max((at - self.start) * self._per // self._ns, -1))

    def keeps(self, number: int) -> bool:
        """Whether a sample has been taken and is still kept."""
        return max(self.taken - len(self._ring) + 1, 0) <= number <= self.taken

    def __getitem__(self, number: int) -> Array:
        """The values (size,) of a sample that is still kept, as a view.

        Raises:
            IndexError: the sample hasn't been taken yet or is no longer kept.
        """
        if not self.keeps(number):
            raise IndexError(f"sample {number} isn't kept; the newest is {self.taken}")
        row: Array = self._ring[number % len(self._ring)]
        return row

    @property
    def due(self) -> int:
        """World time at which the next sample is due, ns."""
        return self.taken_at(self.taken + 1)

    def take(self) -> None:
        """Takes the next sample from the present state of the world."""
        self.taken += 1
        self._ring[self.taken % len(self._ring)] = self._take()

    def save(self) -> Array:
        """Its state, of fixed size."""
        return np.concatenate([[float(self.taken)], self._ring.ravel()])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        self.taken = int(state[0])
        self._ring[...] = state[1:].reshape(self._ring.shape)
