"""The guided procedure that records a person's actions: what to do now, what counts, when a step is over.

Pure: it is fed with samples and asked for its view. In each round the person stands at ease, does every action once in
an order that changes, and walks. At the end the person moves as all day, and means nothing by it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, cast, get_args

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.guided import Bar, StepProcedure, View
from srl.commissioning.calibration.intention import marks
from srl.commissioning.calibration.intention.samples import Samples
from srl.control.intention.features import POSTURE
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Action, Everyday, Instruction, Perform, Rest, Walk

ACTIONS: Final[tuple[str, ...]] = get_args(Action)
_SEEN: Final = 0.9  # share of samples that must be measured
_MOVED: Final = 0.15  # by which a direction must change in an action, as the sine of an angle
_WORDS: Final[dict[str, str]] = {
    "overhead": "Lift both hands over your head, as if to hold up a panel",
    "forward": "Stretch both hands forward at the height of your chest",
    "reach-left": "Stretch the left hand out to the left",
    "reach-right": "Stretch the right hand out to the right",
    "carry": "Hold both forearms forward, as if to carry a box",
    "bend": "Bend forward and let your hands hang, as if to pick something up",
    "squat": "Go down on bent knees",
    "turn-left": "Turn your trunk to the left, the feet stay",
    "turn-right": "Turn your trunk to the right, the feet stay",
    "wave": "Lift the right hand beside your head, and wave",
}


class Plan(Options):
    """How long the steps take."""

    rounds: int = Field(5, ge=3, le=marks.MOST_ROUNDS, description="how often each action is done")
    stand: float = Field(5.0, ge=3.5, description="s of standing at ease at the beginning of each round")
    action: float = Field(3.0, ge=2.0, description="s of each action, from its word on")
    pause: float = Field(2.5, ge=1.0, description="s at ease after each action")
    walk: float = Field(8.0, ge=3.5, description="s of walking at the end of each round")
    everyday: float = Field(
        185.0, ge=0.0, le=3600.0, description="s of everyday motion at the end, which must trigger nothing; 0: none"
    )
    patience: float = Field(20.0, gt=0.0, description="s beyond its time after which a step ends as it is")


class Kind(Enum):
    """Kind of a step."""

    STAND = "stand"
    ACTION = "action"
    PAUSE = "pause"
    WALK = "walk"
    EVERYDAY = "everyday"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `turn`, the round, and `action`, its number, from 0 on where there are such.

    `undone`: of a pause, the mark that takes back the trial before.
    """

    kind: Kind
    turn: int = -1
    action: int = -1
    undone: int = field(default=marks.IDLE, compare=False)

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        number = {
            Kind.STAND: marks.STAND, Kind.WALK: marks.WALK, Kind.EVERYDAY: marks.EVERYDAY, Kind.ACTION: self.action,
        }.get(self.kind)  # fmt: skip
        return self.undone if number is None else marks.mark_of(self.turn, number)


class Procedure(StepProcedure):
    """Goes from step to step as samples come; see the module's docstring."""

    def __init__(self, actions: tuple[str, ...], plan: Plan | None = None, again: bool = False) -> None:
        """`again`: all was recorded before, and only what `redo` says is left to do."""
        self.actions, self.plan = actions, plan or Plan()
        self._states = ["done" if again else "waiting"] * len(actions)
        self._left: deque[Step] = deque()
        for turn in range(0 if again else self.plan.rounds):
            self._left.append(Step(Kind.STAND, turn))
            for number in np.random.default_rng(turn).permutation(len(actions)).tolist():
                self._left += self._trial(turn, number)
            self._left.append(Step(Kind.WALK, turn))
        if self.plan.everyday > 0.0 and not again:
            self._left.append(Step(Kind.EVERYDAY, 0))
        self._next()

    def _columns_of(self, samples: Samples, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.frames[own][:, :POSTURE]

    def _fed(self) -> None:
        lost = 1.0 - float(np.isfinite(self._columns[1]).all(axis=1).mean())
        self._lack = f"{lost:.0%} of the samples are missing" if lost > 1.0 - _SEEN else ""
        self._lost = lost
        if self.step.kind in (Kind.ACTION, Kind.EVERYDAY) and not self._lack and self._moved() < _MOVED:
            self._lack = "nothing has moved"
        elapsed, span = self._elapsed(), self._span()
        if elapsed >= span and (not self._lack or elapsed >= span + self.plan.patience):
            self.go_on()

    def instruction(self) -> Instruction:
        """The instruction to a simulated person at the present step. Raises ValueError: it can't do that."""
        if self.step.kind is Kind.ACTION:
            name = self.actions[self.step.action]
            if name not in ACTIONS:
                raise ValueError(f"a simulated wearer can't do '{name}'")
            return Perform(cast(Action, name))
        if self.step.kind is Kind.EVERYDAY:
            return Everyday()
        return Walk() if self.step.kind is Kind.WALK else Rest()

    def go_on(self) -> str:
        if not self.done:
            if self.step.kind is Kind.ACTION:
                self._note()
            self._next()
        return ""

    def skip(self) -> str:
        return "an action can't be left out now: begin again with --actions"

    def redo(self, number: int) -> str:
        """Does all repetitions of an action (from 1 on) again, next. Returns why that can't be; "" if it could."""
        if not 1 <= number <= len(self.actions):
            return f"the actions are 1 to {len(self.actions)}"
        at = number - 1
        left = deque(step for step in ([] if self.done else [self.step, *self._left]) if step.action != at)
        for turn in range(self.plan.rounds):
            left.extendleft(reversed(self._trial(self.plan.rounds - 1 - turn, at)))
        trial = self.step.kind in (Kind.STAND, Kind.ACTION, Kind.WALK, Kind.EVERYDAY)
        left.appendleft(Step(Kind.PAUSE, undone=marks.VOID if trial else marks.IDLE))
        self._left, self._states[at] = left, "waiting"
        self._next()
        return ""

    def view(self) -> View:
        turn = max(self.step.turn, 0) + 1 if not self.done else self.plan.rounds
        # What an action lacks, it may still get in its time.
        lack = self._lack if self._elapsed() >= self._span() else ""
        progress = min(self._elapsed() / self._span(), 1.0)
        lost = f"{self._lost:.0%} of the samples are missing" if self._lost > 0.0 else ""
        bars = (
            Bar("step", progress, self.step.kind.value),
            Bar("round", turn / self.plan.rounds, f"{turn} of {self.plan.rounds}"),
        )
        return View(self.step, self._task(), lack, lost, tuple(self._states), bars, "actions")

    @staticmethod
    def _trial(turn: int, number: int) -> list[Step]:
        return [Step(Kind.ACTION, turn, number), Step(Kind.PAUSE, turn, number)]

    def _next(self) -> None:
        self._begin(self._left.popleft() if self._left else Step(Kind.DONE))
        # An action that is ended before a sample has come isn't done.
        self._lack, self._lost = "nothing was seen" if self.step.kind is Kind.ACTION else "", 0.0
        if self.step.kind is Kind.ACTION and not self._states[self.step.action].startswith("weak"):
            self._states[self.step.action] = "now"

    def _note(self) -> None:
        at = self.step.action
        if self._lack:
            self._states[at] = f"weak: repetition {self.step.turn + 1}: {self._lack}"
        elif not self._states[at].startswith("weak"):
            waits = any(step.action == at and step.kind is Kind.ACTION for step in self._left)
            self._states[at] = "waiting" if waits else "done"

    def _span(self) -> float:
        """s that the step takes at best."""
        plan = self.plan
        spans = {
            Kind.STAND: plan.stand, Kind.ACTION: plan.action, Kind.PAUSE: plan.pause, Kind.WALK: plan.walk,
            Kind.EVERYDAY: plan.everyday,
        }  # fmt: skip
        return spans.get(self.step.kind, 1.0)

    def _moved(self) -> float:
        """The largest range of a number that describes the posture."""
        if not self._columns:
            return 0.0
        frames = self._columns[1]
        seen: Array = frames[np.isfinite(frames).all(axis=1)]
        return float(np.ptp(seen, axis=0).max()) if len(seen) else 0.0

    def _task(self) -> str:
        step = self.step
        if step.kind is Kind.DONE:
            return "All actions are done"
        if step.kind is Kind.ACTION:
            name = self.actions[step.action]
            what = _WORDS.get(name, f"Do {name}")
            return f"{what}; go on until the next word ({name}, {step.turn + 1} of {self.plan.rounds})"
        if step.kind is Kind.WALK:
            return f"Walk about at an easy pace (round {step.turn + 1} of {self.plan.rounds})"
        if step.kind is Kind.EVERYDAY:
            return "Move as you do all day: reach for things, turn, walk, talk; do none of the actions on purpose"
        if step.kind is Kind.STAND:
            return f"Stand at ease, the arms hanging (round {step.turn + 1} of {self.plan.rounds})"
        return "And back: stand at ease"
