"""The root mean square of each channel's newest samples, updated with every new sample."""

from __future__ import annotations

import numpy as np

from srl.runtime.contracts.signals import Array


class Envelope:
    """RMS over a sliding window.

    Attributes:
        value: (n,), one per channel, in the channels' unit; 0 before the first sample.
    """

    def __init__(self, channels: int, window: int) -> None:
        """`window`: samples."""
        self.value = np.zeros(channels)
        self._squares = np.zeros((window, channels))
        self._at = 0

    def take(self, samples: Array) -> None:
        """Adds samples (k, n), oldest first."""
        window = len(self._squares)
        squares = samples[-window:] ** 2
        first = min(len(squares), window - self._at)
        self._squares[self._at : self._at + first] = squares[:first]
        self._squares[: len(squares) - first] = squares[first:]
        self._at = (self._at + len(squares)) % window
        # Summed anew each time, because a running sum of differences would drift.
        np.sqrt(self._squares.mean(axis=0), out=self.value)
