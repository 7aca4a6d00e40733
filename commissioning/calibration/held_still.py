"""The engine of guided procedures in which one thing after another is held still: poses, points, shapes, stands."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.guided import Bar, StepProcedure, View
from srl.commissioning.calibration.marks import IDLE, MarkedSamples, held
from srl.runtime.contracts.signals import Array

LEFT_OUT: Final = 100  # added to a thing's number: it is left out


class Kind(Enum):
    """Kind of a step."""

    GO = "go"
    HOLD = "hold"
    PAUSE = "pause"
    LEAVE = "leave out"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `number`: of the thing it is about, from 1 on; of a pause, the thing that follows."""

    kind: Kind
    number: int = 0

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return {Kind.HOLD: self.number, Kind.LEAVE: LEFT_OUT + self.number}.get(self.kind, IDLE)


class HeldStill(StepProcedure):
    """Each thing is held still: it begins once all is still and unlike in those before, and counts for `hold` seconds.

    Attributes:
        things: what a person calls them: "poses".
        fewest: how many must remain when some are left out; None: each is needed.
    """

    things: str
    fewest: int | None = None

    def __init__(self, numbers: Sequence[int], again: bool, settle: float, hold: float, most: float) -> None:
        """
        Args:
            numbers: of the things.
            again: of an earlier session; nothing is left to do until `redo` says so.
            settle: s for which all must be still before a thing counts.
            hold: s of it that count.
            most: by which it may move meanwhile, as `_motion` says.
        """
        self._numbers = tuple(numbers)
        self._open = [] if again else list(numbers)
        self._out: set[int] = set()
        self._settle, self._hold, self._most = settle, hold, most
        self._next()

    def _next(self) -> None:
        if self._open:
            self._go(self._open[0])
        else:
            self._begin(Step(Kind.DONE))

    def _go(self, number: int) -> None:
        self._begin(Step(Kind.GO, number))

    def _begin(self, step: Any) -> None:
        super()._begin(step)
        self._since = np.nan  # s, of the step's first sample
        self._disturbed = False  # whether it was moved while it was held, so that it begins again

    @abstractmethod
    def _motion(self) -> float:
        """How far what was measured lately (`_recent`) has moved; infinite where it isn't measured."""

    def _moved(self) -> float:
        """How far it has moved lately; infinite while that isn't known."""
        return float("inf") if self._elapsed() < self._wait else self._motion()

    def _still(self) -> bool:
        """Whether nothing has moved lately."""
        return self._moved() <= self._most

    def _ready(self) -> bool:
        """Whether what is still may count."""
        return not self._lack()

    @abstractmethod
    def _keep(self, number: int) -> bool:
        """Takes the samples of a thing that was held. Returns whether they are good."""

    def _forget(self, number: int) -> None:
        """Drops what is known of a thing."""

    @property
    def _wait(self) -> float:
        """s for which it must be still before it counts."""
        return self._settle

    def _fed(self) -> None:
        if np.isnan(self._since):
            self._since = float(self._times[0])
        if self.step.kind is Kind.LEAVE:
            self._next()
        elif self.step.kind is Kind.PAUSE:
            self._drop_old()
            self._pause()
        elif self.step.kind is Kind.GO:
            self._drop_old()
            if self._still() and self._ready():
                self._begin(Step(Kind.HOLD, self.step.number))
        elif self._elapsed() >= self._settle and not self._still():
            self._again(self.step.number)
        elif self._elapsed() >= self._hold:
            self._take()

    def _pause(self) -> None:
        """Ends a pause before a thing, once it is over."""

    def _drop_old(self) -> None:
        """Of a way of minutes only the end is looked at."""
        recent = self._times >= self._times[-1] - 2.0 * self._wait
        self._columns = tuple(column[recent] for column in self._columns)

    def _take(self) -> None:
        number = self.step.number
        if not self._keep(number):
            self._again(number)
            return
        self._out.discard(number)
        self._open.remove(number)
        self._next()

    def _again(self, number: int) -> None:
        """It was moved: its samples are too few, so they don't count."""
        self._go(number)
        self._disturbed = True

    def go_on(self) -> str:
        if self.step.kind is Kind.GO:
            self._begin(Step(Kind.HOLD, self.step.number))
        return f"hold it still for {self._hold:g} s" if self.step.kind is Kind.HOLD else ""

    def skip(self) -> str:
        if self.fewest is None:
            return "" if self.done else f"every {self.things.removesuffix('s')} is needed"
        if self.step.kind not in (Kind.GO, Kind.HOLD):
            return ""
        number = self.step.number
        if len(self._numbers) - len(self._out | {number}) < self.fewest:
            return f"{self.fewest} {self.things} must remain"
        self._out.add(number)
        self._forget(number)
        self._open.remove(number)
        self._begin(Step(Kind.LEAVE, number))
        return ""

    def redo(self, number: int) -> str:
        if number not in self._numbers:
            return f"the {self.things} are {self._numbers[0]} to {self._numbers[-1]}"
        if number in self._open:
            self._open.remove(number)
        self._open.insert(0, number)
        self._forget(number)
        self._out.discard(number)
        self._go(number)
        return ""

    @abstractmethod
    def _task(self) -> str:
        """What to do at a step that isn't held."""

    def _lack(self) -> str:
        """Why what is still doesn't count yet; "" for nothing."""
        return ""

    def _missing(self) -> str:
        """What isn't measured now; "" for nothing."""
        return ""

    @abstractmethod
    def _bars(self) -> Sequence[Bar]:
        """What is measured, below how long it has been held."""

    def view(self) -> View:
        one = self.things.removesuffix("s")
        words = {
            Kind.GO: self._task, Kind.PAUSE: self._task, Kind.HOLD: self._held_task,
            Kind.LEAVE: lambda: f"{one.capitalize()} {self.step.number} is left out",
            Kind.DONE: lambda: f"All {self.things} are done",
        }  # fmt: skip
        held = self._elapsed() / self._hold if self.step.kind is Kind.HOLD else float(self.done)
        bars = [Bar("held", min(held, 1.0), f"{one} {self.step.number}" if self.step.number else "")]
        bars = [*(() if self.step.kind is Kind.PAUSE else bars), *self._bars()]
        lack = self._lack() if self.step.kind is Kind.GO else ""
        if self._disturbed and not lack:
            lack = "it moved while it was held, so it begins again"
        return View(self.step, words[self.step.kind](), lack, self._missing(), self._states(), bars, self.things)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.number and self.step.kind is not Kind.PAUSE:
                return "now"
            if number in self._open:
                return "waiting"
            return "left out" if number in self._out else "done"

        return tuple(state(number) for number in self._numbers)

    def _held_task(self) -> str:
        return "Hold still"

    def _recent(self, column: int) -> Array:
        """The newest samples of a column, of the time for which it must be still."""
        return self._columns[column][self._times >= self._times[-1] - self._wait]


def still_bar(moved: float, most: float, text: str) -> Bar:
    """How far it has moved lately, beside what it may; nothing while that isn't known."""
    if not np.isfinite(moved):
        return Bar("still", None, "")
    return Bar("still", min(moved / (2.0 * most), 1.0), text, moved <= most)


def block_motion(values: Array, blocks: int = 5) -> float:
    """How far the means of consecutive blocks are apart at most, in the unit of values (T, n).

    Infinite where one isn't measured. Means are compared, so that noise doesn't look like motion.
    """
    if len(values) < blocks or not np.isfinite(values).all():
        return float("inf")
    means = np.array([block.mean(axis=0) for block in np.array_split(values, blocks)])
    return float(np.linalg.norm(means[:, None] - means, axis=2).max())


def held_poses(samples: MarkedSamples, count: int, hold: float) -> dict[int, slice]:
    """By number of each thing, 1 to `count`, that was held for `hold` s and not left out later: its last samples."""
    found = {}
    for number in range(1, count + 1):
        at, out = held(samples, number, hold), np.flatnonzero(samples.marks == LEFT_OUT + number)
        if at is not None and not (len(out) and out[-1] >= at.stop):
            found[number] = at
    return found
