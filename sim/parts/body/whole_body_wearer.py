"""The wearer of the part `body`: does the ten actions in turn, until somebody tells it what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, get_args

import numpy as np

from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Action, Instruction, Perform, Rest
from srl.sim.wearer.people import Subject
from srl.sim.wearer.performer import Performer

ACTION: Final = 3.0  # s, that each action takes of the plan


class WholeBodyWearer:
    """A motion (`srl.sim.parts.body.motion.Motion`), and a wearer (`srl.runtime.contracts.wearer.Wearer`).

    Attributes: `offsets` (59, 3), m.
    """

    def __init__(self, who: Subject, skeleton: Skeleton, scale: float, pause: float) -> None:
        """`pause`: s at ease before each action of the plan."""
        self._person = Performer(who, skeleton, scale)
        self.offsets = self._person.offsets
        self._pause = pause
        self._now = 0.0
        self._instructed = False

    def at(self, t: float) -> tuple[Array, Array]:
        """Hips (3,), m, and unit quaternions (59, 4), w x y z, at t seconds."""
        self._now = max(t, self._now)
        while not self._instructed and (begins := self._due(self._person.count)) <= t:
            self._person.instruct(begins, self._planned(self._person.count))
        return self._person.at(t)

    @property
    def done(self) -> bool:
        """Whether the last instruction is reached."""
        return self._person.there(self._now)

    def instruct(self, instruction: Instruction) -> None:
        """Ends what it is doing, and the plan, and begins this. Raises ValueError: a whole body can't."""
        self._person.instruct(self._now, instruction)
        self._instructed = True

    def see(self, pointers: Sequence[float]) -> None:
        """It watches nothing."""

    def save(self) -> Array:
        """Its state. It can only be restored where the same instructions were given."""
        return np.array([self._now, self._instructed, self._person.count], float)

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`. Raises ValueError: it wasn't given all the instructions."""
        now, instructed, count = state.tolist()
        if count > self._person.count:
            raise ValueError("this wearer wasn't given all the instructions of the saved one")
        self._person.forget(int(count))
        self._now, self._instructed = now, bool(instructed)

    def _due(self, number: int) -> float:
        action, rest = divmod(number, 2)
        return action * (self._pause + ACTION) + self._pause + rest * ACTION

    @staticmethod
    def _planned(number: int) -> Instruction:
        actions = get_args(Action)
        return Rest() if number % 2 else Perform(actions[number // 2 % len(actions)])
