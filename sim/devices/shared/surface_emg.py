"""Surface EMG of simulated muscles: noise in the band of muscles, to be scaled with the activation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.world.cell import Cell

_BLOCK: Final = 2048  # number of samples whose noise is made together
_TAPS: Final = 101
_BAND: Final = (20.0, 450.0)  # Hz, band that contains the power of surface EMG


class Muscles(Protocol):
    """A part of the cell that has muscles."""

    def activation(self, muscle: str) -> float:
        """The present activation, from 0 (relaxed) to 1 (greatest voluntary contraction)."""
        ...


def muscles(world: World, place: str, named: str) -> Muscles:
    """The cell's part with muscles. Raises WiringError, at `place`: there is none of that name."""
    if not isinstance(world, Cell) or named not in world.parts:
        raise WiringError(place, f"the world has no part '{named}'", "Name one of sim.parts, or leave it out")
    part = world.parts[named]
    if not hasattr(part, "activation"):
        raise WiringError(place, f"the part '{named}' has no muscles", "Name a simulated person")
    return part


class SurfaceEmg:
    """Noise of electrodes, the same for any order of asking; it depends only on key, channel and sample."""

    def __init__(self, key: Sequence[int], channels: int, rate: float) -> None:
        """
        Args:
            key: the randomness.
            channels: how many there are.
            rate: Hz; below 1000 the band ends sooner.
        """
        self._key, self._channels = key, channels
        self._white: dict[int, Array] = {}
        self._kernel = _band_pass(rate)

    def unit(self, first: int, count: int, channel: int) -> tuple[Array, Array]:
        """Noise in the muscles' band and of the electronics, (count,) each, RMS 1, for samples from `first` on."""
        wanted = np.arange(first - _TAPS + 1, first + count) + _TAPS  # numbers start at 1
        blocks = {int(block): self._drawn(int(block)) for block in np.unique(wanted // _BLOCK)}
        white = np.array([blocks[n // _BLOCK][channel, n % _BLOCK] for n in wanted.tolist()])
        return np.convolve(white, self._kernel, "valid"), white[-count:]

    def _drawn(self, block: int) -> Array:
        if block not in self._white:
            rng = np.random.default_rng([*self._key, 0, block])
            self._white = {k: v for k, v in self._white.items() if k == block - 1}
            self._white[block] = rng.normal(size=(self._channels, _BLOCK))
        return self._white[block]


def _band_pass(rate: float) -> Array:
    """A windowed-sinc band-pass, scaled so that white noise of RMS 1 keeps this RMS."""
    n = np.arange(_TAPS) - _TAPS // 2
    low, high = (2 * f / rate * np.sinc(2 * f / rate * n) for f in (_BAND[0], min(_BAND[1], 0.45 * rate)))
    kernel: Array = (high - low) * np.hamming(_TAPS)
    kernel /= np.sqrt((kernel**2).sum())
    return kernel
