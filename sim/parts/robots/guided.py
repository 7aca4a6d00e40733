"""A person who leads a simulated arm by hand, as a calibration says: joint angles, smooth from posture to posture."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Lead, Rest
from srl.runtime.models.robots import RobotDescription
from srl.sim.wearer.motion import quintic

_SECONDS: Final = 3.0  # s that a way takes; ours
_REACH: Final = 0.5  # rad, from home, the most of each joint; ours
_ROOM: Final = 0.05  # rad, to the ends of the joints


class Guided:
    """The wearer of an arm that has `guided`. It never leads the arm to the same posture twice."""

    def __init__(self, robot: RobotDescription, home: Array, seed: int) -> None:
        self._robot, self._home, self._seed = robot, home, seed
        self._from, self._to = home.copy(), home.copy()
        self._since, self._instructed = 0.0, 0
        self._now = 0.0

    @property
    def done(self) -> bool:
        """Whether it is there."""
        return self._now >= self._since + _SECONDS

    def instruct(self, instruction: Instruction) -> None:
        """From now on leads the arm elsewhere; else lets it rest. Raises ValueError: a hand alone can't do it."""
        if isinstance(instruction, Rest):
            return
        if not isinstance(instruction, Lead):
            raise ValueError(f"who leads an arm isn't told to {type(instruction).__name__}: Lead or Rest")
        self._from, self._since = self.at(self._now), self._now
        self._instructed += 1
        random = np.random.default_rng((self._seed, instruction.number, self._instructed))
        q = self._home + random.uniform(-_REACH, _REACH, self._robot.n)
        self._to = np.clip(q, self._robot.q_lower + _ROOM, self._robot.q_upper - _ROOM)

    def see(self, pointers: Any) -> None:
        """It sees nothing."""

    def at(self, t: float) -> Array:
        """(n,) rad at t seconds of the world."""
        self._now = t
        share = quintic(min(max((t - self._since) / _SECONDS, 0.0), 1.0))
        found: Array = self._from + share * (self._to - self._from)
        return found

    def save(self) -> Array:
        return np.array([*self._from, *self._to, self._since, self._instructed, self._now])

    def restore(self, state: Array) -> None:
        n = self._robot.n
        self._from, self._to = state[:n].copy(), state[n : 2 * n].copy()
        self._since, self._instructed, self._now = float(state[2 * n]), int(state[2 * n + 1]), float(state[2 * n + 2])
