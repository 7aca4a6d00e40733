"""What the guide of a calibration asks of a procedure, whatever is calibrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from srl.commissioning.calibration.marks import Indices
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


class Samples(Protocol):
    """Samples of a run, each with the mark of what was to be done."""

    @property
    def marks(self) -> Indices:
        """(T,)."""


class Procedure(Protocol):
    """Goes from step to step as samples come."""

    @property
    def step(self) -> Step:
        """The present one."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""

    def feed(self, samples: Any) -> None:
        """Takes new samples, as the method's own kind; those that bear another mark than the step's don't count."""

    def instruction(self) -> Instruction:
        """The instruction to a simulated person at the present step."""

    def go_on(self) -> str:
        """Ends the present step as it is. Returns why that can't be; "" if it could."""

    def skip(self) -> str:
        """Leaves the present thing out. Returns why that can't be; "" if it could."""

    def redo(self, number: int) -> str:
        """Does a thing (from 1 on) again, next. Returns why that can't be; "" if it could."""

    def view(self) -> View:
        """What a person is shown now."""
