"""A simulated person's unintended motion: tremor, force noise, and drift in the perceived position of objects."""

from __future__ import annotations

import zlib
from math import exp, sin, sqrt, tau
from typing import Final

import numpy as np

_BLOCK: Final = 256  # number of updates whose random numbers are drawn together
_TONES: Final = 3  # sinusoids per axis
_BAND: Final = (8.0, 12.0)  # Hz, sheet human_body


class Tremor:
    """A force that shakes the free hand with a given amplitude: three sinusoids per axis in 8-12 Hz, from the seed."""

    def __init__(self, seed: int, name: str, amplitude: float, mass: float) -> None:
        """
        Args:
            amplitude: m, RMS of the free hand's motion along an axis.
            mass: kg, mass of that hand.
        """
        rng = np.random.default_rng([seed, zlib.crc32(name.encode()), 1])
        frequency = tau * rng.uniform(*_BAND, (3, _TONES))
        phase = rng.uniform(0.0, tau, (3, _TONES))
        force = amplitude * sqrt(2.0 / _TONES) * mass * frequency**2
        self._tones: list[list[tuple[float, float, float]]] = [
            list(zip(f.tolist(), w.tolist(), p.tolist(), strict=True))
            for f, w, p in zip(force, frequency, phase, strict=True)
        ]

    def at(self, t: float) -> tuple[float, float, float]:
        """The force in N, world axes, at t seconds of world time."""
        x, y, z = [sum([f * sin(w * t + p) for f, w, p in tones]) for tones in self._tones]
        return (x, y, z)


class Wander:
    """Six values that vary randomly about zero (Ornstein-Uhlenbeck), each with standard deviation 1.

    The caller stores the values. The numbers drawn depend only on the seed, the name and the number of the update.
    """

    def __init__(self, seed: int, name: str, dt: float, constants: tuple[float, ...]) -> None:
        """Args: dt, s between updates; constants, s, correlation times of the values, (6,)."""
        self._key = [seed, zlib.crc32(name.encode()), 2]
        self._keep = [exp(-dt / constant) for constant in constants]
        self._add = [sqrt(1.0 - keep * keep) for keep in self._keep]
        self._block = -1
        self._drawn: list[list[float]] = []

    def next(self, values: tuple[float, ...], number: int) -> tuple[float, ...]:
        """Returns the values at update `number`, from those of the previous update."""
        block, row = divmod(number, _BLOCK)
        if block != self._block:
            self._drawn = np.random.default_rng([*self._key, block]).normal(size=(_BLOCK, len(self._keep))).tolist()
            self._block = block
        return tuple(
            [k * v + a * x for k, v, a, x in zip(self._keep, values, self._add, self._drawn[row], strict=True)]
        )
