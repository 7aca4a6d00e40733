"""Teaching while the service runs: the hand's samples, then the check, a little in each cycle."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.operation.demonstration import LONGEST, TaskError, TaskPath, Thresholds, path_of
from srl.control.operation.reach import Reach
from srl.control.operation.worn import Worn
from srl.control.skeleton.ranges import JointRanges
from srl.runtime.contracts.signals import Array

_SPACING: Final = 0.005  # s, the least between two samples that are kept
_STEPS: Final = 4  # of the check, in one cycle


class Teaching:
    """One demonstration after the other.

    Attributes:
        on: the hand is showing a task.
        refused: why the last demonstration can't be repeated; empty if it can.
    """

    def __init__(self, arm: Worn, ranges: JointRanges, thresholds: Thresholds, shift: Array) -> None:
        self.on, self.refused = False, ""
        self._arm, self._ranges, self._thresholds, self._shift = arm, ranges, thresholds, shift
        self._samples = np.empty((round((LONGEST + 5.0) / _SPACING), 4))
        self._count, self._time = 0, 0.0
        self._path: TaskPath | None = None
        self._reach: Reach | None = None

    @property
    def checking(self) -> bool:
        """A demonstration is being checked."""
        return self._reach is not None

    def begin(self) -> None:
        """The hand begins to show a task; one that is being checked is given up."""
        self.on, self.refused = True, ""
        self._count, self._time, self._path, self._reach = 0, 0.0, None, None

    def sample(self, hand: Array, dt: float) -> None:
        """Takes the hand's place (3,) m in the carrier's frame, dt s after the last."""
        self._time += dt
        n = self._count
        if n < len(self._samples) and (n == 0 or self._time - self._samples[n - 1, 0] >= _SPACING - 1e-9):
            self._samples[n, 0], self._samples[n, 1:] = self._time, hand
            self._count += 1

    def end(self, q: Array) -> None:
        """The task is shown; q (n,) rad or m, where the arm is."""
        self.on = False
        shown = self._samples[: self._count]
        try:
            path = path_of(shown[:, 0], shown[:, 1:], self._thresholds)
            self._path = TaskPath(path.points + self._shift)
            self._reach = Reach(self._path, self._arm, self._ranges, q)
        except TaskError as error:
            self.refused = str(error)

    def drop(self, why: str) -> None:
        """Gives up what is being shown or checked."""
        if self.on or self.checking:
            self.on, self._reach, self.refused = False, None, why

    def check(self) -> TaskPath | None:
        """Goes on checking; returns the path once the arm can follow it. Uses the arm's kinematics."""
        if self._reach is None:
            return None
        try:
            if not self._reach.step(_STEPS):
                return None
        except TaskError as error:
            self._reach, self.refused = None, str(error)
            return None
        self._reach = None
        return self._path
