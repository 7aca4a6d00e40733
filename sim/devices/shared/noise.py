"""Noise and losses of a sensor's samples: it depends on seed, device and the sample's number alone."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np

from runtime.contracts.signals import Array

_BLOCK: Final = 128  # samples whose random numbers are drawn at once


class SampleNoise:
    """A fake without a state of its own needs randomness without one: drawn anew for any sample, in any order."""

    def __init__(self, seed: int, name: str, size: int, noise: float) -> None:
        """
        Args:
            seed: the world's.
            name: the device's.
            size: values in a sample.
            noise: their standard deviation.
        """
        self._key = [seed, zlib.crc32(name.encode())]
        self._size, self._sigma = size, noise
        self._block = -1
        self._uniform: list[float] = []
        self._noise = np.empty((0, 0))

    def uniform(self, number: int) -> float:
        """From 0 to 1: decides whether sample `number` gets lost."""
        row = self._row(number)
        return self._uniform[row]

    def noise(self, number: int) -> Array:
        """The noise (size,) of sample `number`; a view."""
        row = self._row(number)
        noise: Array = self._noise[row]
        return noise

    def _row(self, number: int) -> int:
        # Drawn in blocks: a generator of its own for each sample would cost more than all else a fake does.
        block, row = divmod(number, _BLOCK)
        if block != self._block:
            rng = np.random.default_rng([*self._key, block])
            self._uniform = rng.random(_BLOCK).tolist()
            self._noise = rng.normal(0.0, self._sigma, (_BLOCK, self._size))
            self._block = block
        return row
