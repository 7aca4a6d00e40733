"""The engine of guided procedures, and what their guide shows, whatever is calibrated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction


@dataclass(frozen=True)
class Bar:
    """A line of what a person is shown.

    Attributes:
        name: what it is of.
        share: 0 to 1 of its length; None: only text.
        text: beside it.
        good: whether it is as it should be; None: there is no such thing.
    """

    name: str
    share: float | None
    text: str
    good: bool | None = None


class Step(Protocol):
    """One thing to do."""

    @property
    def mark(self) -> int:
        """Of its samples."""


@dataclass(frozen=True)
class View:
    """What a person is shown.

    Attributes:
        step: the present one.
        task: what to do now, one sentence.
        lack: why the step isn't over, or what is wrong; "" for nothing.
        missing: what isn't measured now; "" for nothing.
        states: of each thing to be done: waiting, now, done, weak (with the reason), left out.
        bars: how far it is.
        things: what these are: "points".
    """

    step: Step
    task: str
    lack: str
    missing: str
    states: Sequence[str]
    bars: Sequence[Bar]
    things: str


class Procedure(ABC):
    """A guided procedure, which goes from step to step as samples come.

    Attributes:
        step: the present step.
    """

    step: Any

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return bool(self.step.kind.value == "done")

    @abstractmethod
    def feed(self, samples: Any) -> None:
        """Takes new samples, as the method's own kind; those that bear another mark than the step's don't count."""

    @abstractmethod
    def instruction(self) -> Instruction:
        """The instruction to a simulated person at the present step."""

    @abstractmethod
    def go_on(self) -> str:
        """Ends the present step as it is. Returns why that can't be; "" if it could."""

    @abstractmethod
    def skip(self) -> str:
        """Leaves the present thing out. Returns why that can't be; "" if it could."""

    @abstractmethod
    def redo(self, number: int) -> str:
        """Does a thing (from 1 on) again, next. Returns why that can't be; "" if it could."""

    @abstractmethod
    def view(self) -> View:
        """What a person is shown now."""


class StepProcedure(Procedure):
    """A procedure that looks at all samples of its present step.

    They come in columns, each (T, ...); the first is time in s.
    """

    _columns: tuple[Array, ...] = ()

    def _begin(self, step: Step) -> None:
        self.step = step
        self._columns = ()

    def feed(self, samples: Any) -> None:
        own = samples.marks == self.step.mark
        if not own.any() or self.done:
            return
        new, before = self._columns_of(samples, own), self._columns
        self._columns = tuple(map(np.concatenate, zip(before, new, strict=True))) if before else new
        self._fed()

    @abstractmethod
    def _columns_of(self, samples: Any, own: Any) -> tuple[Array, ...]:
        """Times and values of the samples at `own`."""

    @abstractmethod
    def _fed(self) -> None:
        """Looks at the step's samples, which are more now: whether it is over."""

    @property
    def _times(self) -> Array:
        return self._columns[0] if self._columns else np.empty(0)

    def _elapsed(self) -> float:
        """s, from the step's first sample to its last."""
        return float(self._times[-1] - self._times[0]) if len(self._times) else 0.0
