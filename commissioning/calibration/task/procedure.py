"""The guided demonstration: stand still, show the task with the hand, and rest. Pure: it is fed with samples."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.guided import Bar, StepProcedure, View
from srl.commissioning.calibration.marks import IDLE
from srl.commissioning.calibration.task import samples as marks
from srl.commissioning.calibration.task.samples import Samples
from srl.control.operation.demonstration import LONGEST
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Perform, Rest

_MOVED = 0.05  # m from where it was first: the hand shows something
_STILL = 0.02  # m within which a hand rests


class Plan(Options):
    """How long the steps take."""

    stand: float = Field(2.0, ge=0.5, description="s still before the task is shown")
    rest: float = Field(1.5, ge=0.5, description="s for which the hand rests at the task's end")
    show: float = Field(LONGEST, ge=2.0, le=LONGEST, description="s, the most")


class Kind(Enum):
    """Kind of a step."""

    STAND = "stand"
    SHOW = "show"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step."""

    kind: Kind

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return {Kind.STAND: marks.STILL, Kind.SHOW: marks.SHOWN, Kind.DONE: IDLE}[self.kind]


class Procedure(StepProcedure):
    """Goes from step to step as samples come."""

    def __init__(self, plan: Plan | None = None, again: bool = False) -> None:
        """`again`: it was shown before; nothing is left to do until `redo` says so."""
        self.plan = plan or Plan()
        self._begin(Step(Kind.DONE if again else Kind.STAND))

    def _columns_of(self, samples: Samples, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.hand[own]

    @property
    def _hand(self) -> Array:
        """(T, 3) m."""
        return self._columns[1] if self._columns else np.empty((0, 3))

    def _fed(self) -> None:
        if self.step.kind is Kind.STAND:
            if self._rests(self.plan.stand):
                self.go_on()
        elif (self._moved() and self._rests(self.plan.rest)) or self._elapsed() >= self.plan.show:
            self.go_on()

    def instruction(self) -> Instruction:
        """The instruction to a simulated person at the present step: its task is to take both hands forward."""
        return Perform("carry") if self.step.kind is Kind.SHOW else Rest()

    def go_on(self) -> str:
        if not self.done:
            self._begin(Step(Kind.SHOW if self.step.kind is Kind.STAND else Kind.DONE))
        return ""

    def skip(self) -> str:
        return "there is only one task"

    def redo(self, number: int) -> str:
        if number != 1:
            return "there is one task, number 1"
        self._begin(Step(Kind.STAND))
        return ""

    def view(self) -> View:
        lost = 1.0 - float(np.isfinite(self._hand).all(axis=1).mean()) if len(self._hand) else 0.0
        words = {
            Kind.STAND: "Stand still, the hand where the task begins or hanging",
            Kind.SHOW: "Show the task with the hand, slowly; then hold the hand still",
            Kind.DONE: "The task is shown",
        }
        span = self.plan.stand if self.step.kind is Kind.STAND else self.plan.show
        lack = "the hand hasn't moved" if self.step.kind is Kind.SHOW and not self._moved() else ""
        missing = f"{lost:.0%} of the samples are missing" if lost > 0.0 else ""
        progress = 1.0 if self.done else min(self._elapsed() / span, 1.0)
        return View(
            self.step, words[self.step.kind], lack, missing, ("done" if self.done else "now",),
            (Bar("step", progress, self.step.kind.value),), "tasks",
        )  # fmt: skip

    def _moved(self) -> bool:
        seen = self._hand[np.isfinite(self._hand).all(axis=1)]
        return len(seen) > 0 and bool((np.linalg.norm(seen - seen[0], axis=1) > _MOVED).any())

    def _rests(self, seconds: float) -> bool:
        """Whether the hand has rested for so long."""
        if self._elapsed() < seconds:
            return False
        last = self._hand[self._times >= self._times[-1] - seconds]
        return bool(np.isfinite(last).all()) and bool((np.ptp(last, axis=0) < _STILL).all())
