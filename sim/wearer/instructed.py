"""A wearer that takes the hand to the shapes that a calibration names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest, Shape
from srl.runtime.models.human_hand import RANGES, SENSORS
from srl.sim.wearer.fitting import Fitted
from srl.sim.wearer.joints import to_model
from srl.sim.wearer.motion import quintic

SECONDS: Final = 0.8  # that a hand takes from one shape to the next; ours


class InstructedWearer:
    """Moves from shape to shape with minimum jerk and holds each, a little off, as hands are.

    It begins flat. The same instructions at the same times give the same bits.
    """

    duration = float("inf")
    fitted: Fitted | None = None

    def __init__(self, seed: int, *, ranges: Array = RANGES, miss: float = 0.0) -> None:
        """
        Args:
            ranges: (20, 2) rad, of the joints.
            miss: rad, standard deviation by which each joint misses its angle.
        """
        self._seed, self._ranges, self._miss = seed, ranges, miss
        self._from = self._to = self._clipped(np.zeros(20))
        self._since, self._now, self._instructed = -SECONDS, 0.0, 0

    def target(self, t: float) -> Array:
        self._now = t
        share = quintic(min(max((t - self._since) / SECONDS, 0.0), 1.0))
        return self._from + share * (self._to - self._from)

    @property
    def done(self) -> bool:
        """Whether the hand has its shape."""
        return self._now >= self._since + SECONDS

    def instruct(self, instruction: Instruction) -> None:
        """From now on takes the hand to the shape, or holds it. Raises ValueError: a hand alone can't do it."""
        if isinstance(instruction, Rest):
            return
        if not isinstance(instruction, Shape):
            raise ValueError(f"a hand alone isn't told to {type(instruction).__name__}: Shape or Rest")
        names = list(dict.fromkeys((*instruction.angles, *SENSORS[22])))
        goal = to_model(names, np.array([[instruction.angles.get(name, 0.0) for name in names]]))
        assert goal is not None
        self._from, self._since = self.target(self._now), self._now
        self._instructed += 1
        off = np.random.default_rng((self._seed, self._instructed)).normal(0.0, 1.0, 20)
        self._to = self._clipped(goal[0] + self._miss * off)

    def see(self, pointers: Sequence[float]) -> None:
        """A hand sees nothing."""

    def save(self) -> Array:
        """What `restore` takes."""
        return np.array([*self._from, *self._to, self._since, self._now, self._instructed])

    def restore(self, state: Array) -> None:
        """Goes on as it was when it was saved."""
        self._from, self._to = state[:20].copy(), state[20:40].copy()
        self._since, self._now, self._instructed = float(state[40]), float(state[41]), int(state[42])

    def _clipped(self, angles: Array) -> Array:
        found: Array = np.clip(angles, *self._ranges.T)
        return found
