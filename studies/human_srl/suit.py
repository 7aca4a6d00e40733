"""What a suit sends of a simulated person: frames that are late, noisy, off, lost, or repeated."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from srl.runtime.contracts.rotation import exp, product
from srl.runtime.contracts.signals import Array

NOISE: Final = 0.002  # rad, of each joint in each frame, as in the simulated suit


class Suit:
    """Takes the person's pose each cycle, and gives a frame in some."""

    def __init__(
        self, period: float, delay: float, rng: np.random.Generator, drop: float = 0.0,
        freeze: tuple[float, float] = (0.0, 0.0), off: Array | None = None,
    ) -> None:  # fmt: skip
        """
        Args:
            period: s between two frames.
            delay: s, from a pose to its frame.
            rng: of noise and losses.
            drop: share of the frames that are lost.
            freeze: from, to (s): then it repeats its last frame.
            off: (n, 4), by which each joint's rotation is wrong all the time, in the joint's frame; None: it isn't.
        """
        self._period, self._delay, self._rng, self._drop, self._freeze = period, delay, rng, drop, freeze
        self._sent: deque[tuple[float, Array]] = deque()
        self._next = 0.0
        self._last: Array | None = None
        self._off = None if off is None else off.tolist()

    def frame(self, t: float, pose: Array) -> Array | None:
        """(n, 4), what arrives at t s while the person is in `pose` (n, 4); None: nothing new."""
        found = None
        if t >= self._next - 1e-9:
            self._sent.append((t + self._delay, pose))
            self._next += self._period
        while self._sent and self._sent[0][0] <= t + 1e-9:
            _, seen = self._sent.popleft()
            lost = self._rng.random() < self._drop
            turns = self._rng.normal(0.0, NOISE, (len(seen), 3)).tolist()
            if lost:
                continue
            if self._off is not None:
                seen = np.array([product(q, wrong) for q, wrong in zip(seen.tolist(), self._off, strict=True)])
            if self._last is None or not self._freeze[0] <= t < self._freeze[1]:
                self._last = np.array([product(q, exp(*turn)) for q, turn in zip(seen.tolist(), turns, strict=True)])
            found = self._last
        return found


def bias(joints: int, degrees: float, rng: np.random.Generator) -> Array:
    """(joints, 4): a constant rotation of each, about any axis, `degrees` rms."""
    turns = rng.normal(0.0, np.radians(degrees) / np.sqrt(3.0), (joints, 3)).tolist()
    return np.array([exp(*turn) for turn in turns])
