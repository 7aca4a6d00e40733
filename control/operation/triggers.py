"""What a person does to a task: presses and actions, of which only the moment at which they begin counts."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from srl.runtime.contracts.signals import Array


class Triggers:
    """Edges of a button's level or count of presses, and of named actions.

    Attributes:
        toggle: a press began in this cycle; the person's actions that began in it: run, pause.
    """

    def __init__(self) -> None:
        self.toggle = self.run = self.pause = False
        self._presses: float | None = None
        self._actions: tuple[float, float] | None = None

    def forget(self) -> None:
        """What is pressed or done now is no edge."""
        self._presses = self._actions = None

    def read(self, input: Mapping[str, Array]) -> bool:
        """Takes `press` (1,) and `action` (2,), run and pause, where they are. False: a value isn't finite."""
        self.toggle = self.run = self.pause = False
        good = True
        if "press" in input:
            now = float(input["press"][0])
            good = isfinite(now)
            if good:
                # A count that falls is a device that began again.
                self.toggle = self._presses is not None and round(now - self._presses) % 2 == 1 and now > self._presses
                self._presses = now
        if "action" in input:
            run, pause = input["action"].tolist()
            if not isfinite(run + pause):
                return False
            before = self._actions or (1.0, 1.0)
            self.run, self.pause = run > 0.5 >= before[0], pause > 0.5 >= before[1]
            self._actions = (run, pause)
        return good
