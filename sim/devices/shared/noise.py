"""Noise and losses of a sensor's samples; they depend only on the seed, the device and the sample's number."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

_BLOCK: Final = 128  # number of samples whose random numbers are drawn together


class SampleNoise:
    """Random numbers of a sensor's samples, drawn again for any sample, in any order.

    A fake without a state of its own needs randomness without a state.
    """

    def __init__(self, seed: int, name: str, size: int, noise: float, scale: float | Array = 1.0) -> None:
        """
        Args:
            seed: the world's seed.
            name: the device's name.
            size: number of values in a sample.
            noise: standard deviation of the values' noise.
            scale: a factor of each value's noise, (size,), or of all.
        """
        self._key = [seed, zlib.crc32(name.encode())]
        self._size, self._sigma, self._scale = size, noise, scale
        self._block = -1
        self._uniform: list[float] = []
        self._noise = np.empty((0, 0))

    def uniform(self, number: int) -> float:
        """A number from 0 to 1 that decides whether sample `number` is lost."""
        row = self._row(number)
        return self._uniform[row]

    def noise(self, number: int) -> Array:
        """The noise (size,) of sample `number`, as a view."""
        row = self._row(number)
        noise: Array = self._noise[row]
        return noise

    def _row(self, number: int) -> int:
        # Drawn in blocks: a separate generator for each sample would cost more than the rest of a fake's work.
        block, row = divmod(number, _BLOCK)
        if block != self._block:
            rng = np.random.default_rng([*self._key, block])
            self._uniform = rng.random(_BLOCK).tolist()
            self._noise = rng.normal(0.0, self._sigma, (_BLOCK, self._size)) * self._scale
            self._block = block
        return row
