"""The guided calibration of a suit: stand, walk about, come back and stand the same way. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.suit.fit import Thresholds, pose_fault
from srl.commissioning.calibration.suit.samples import IDLE, Plan, Samples, moved
from srl.commissioning.calibration.suit.segments import back, heading, in_world, mean, product
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest, Return, Walk

_POSE = {"n": "arms hanging, palms to the thighs", "t": "arms straight out, palms down"}


class Kind(Enum):
    """Kind of a step."""

    COME = "come"
    HOLD = "hold"
    WALK = "walk"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `stand` counts from 1."""

    kind: Kind
    stand: int

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return self.stand if self.kind is Kind.HOLD else IDLE


@dataclass(frozen=True)
class View:
    """What a person is shown. Attributes as in `srl.commissioning.calibration.guided.View`; `reported`: the bars."""

    step: Step
    task: str
    lack: str
    missing: str
    states: tuple[str, ...]
    reported: tuple[Bar, ...]
    things: ClassVar[str] = "stands"

    def bars(self) -> tuple[Bar, ...]:
        """How far it is."""
        return self.reported


class Procedure:
    """Goes from step to step as samples come. A stand begins once the person is still, in the pose, and faces ahead.

    Attributes:
        step: the present step.
    """

    def __init__(self, segments: Sequence[str], parents: Sequence[int], plan: Plan, thresholds: Thresholds) -> None:
        self.plan, self._thresholds = plan, thresholds
        self._segments, self._parents = tuple(segments), tuple(parents)
        self._open = list(range(1, plan.stands + 1))
        self._first: Array | None = None  # (n, 4) of the first stand
        self._begin(Step(Kind.COME, 1))

    def _begin(self, step: Step) -> None:
        self.step = step
        self._times, self._turned = np.empty(0), np.empty((0, len(self._segments), 4))
        self._since = np.nan

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return self.step.kind is Kind.DONE

    def feed(self, samples: Samples) -> None:
        """Takes new samples; those that bear another mark than the step's don't count."""
        own = samples.marks == self.step.mark
        if not own.any() or self.done:
            return
        if np.isnan(self._since):
            self._since = float(samples.times[own][0])
        self._times = np.concatenate([self._times, samples.times[own]])
        self._turned = np.concatenate([self._turned, in_world(samples.rotation[own], self._parents)])
        kind, plan, still = self.step.kind, self.plan, self._thresholds.still
        if kind is not Kind.HOLD:  # a person may take minutes: no more is needed
            recent = self._times >= self._times[-1] - 2.0 * self._wait
            self._times, self._turned = self._times[recent], self._turned[recent]
        if kind is Kind.WALK:
            if self._times[-1] - self._since >= plan.walk:
                self._begin(Step(Kind.COME, self.step.stand + 1))
        elif kind is Kind.COME:
            if self._still(self._wait) <= still and not self._fault():
                self._begin(Step(Kind.HOLD, self.step.stand))
        elif self._elapsed() >= plan.settle and self._still(plan.settle) > still:
            self._begin(Step(Kind.COME, self.step.stand))  # the person moved: its samples are too few, so don't count
        elif self._elapsed() >= plan.hold:
            self._take()

    def _take(self) -> None:
        if moved(self._turned) > self._thresholds.still:
            self._begin(Step(Kind.COME, self.step.stand))
            return
        number = self.step.stand
        if number == 1:
            self._first = mean(self._turned)
        self._open.remove(number)
        self._begin(Step(Kind.WALK, self._open[0] - 1) if self._open else Step(Kind.DONE, 0))

    def instruction(self) -> Instruction:
        """What whoever simulates the person is told at the present step."""
        if self.step.kind is Kind.WALK:
            return Walk()
        return Return() if self.step.kind is Kind.COME else Rest()

    def go_on(self) -> str:
        """Ends the walk early. Returns why that can't be; "" if it could."""
        if self.step.kind is Kind.WALK:
            self._begin(Step(Kind.COME, self.step.stand + 1))
            return ""
        if self.step.kind is Kind.COME:
            return "it begins by itself, once you stand still in the pose"
        return f"stand still for {self.plan.hold:g} s" if self.step.kind is Kind.HOLD else ""

    def skip(self) -> str:
        """Leaves nothing out: each stand is needed."""
        return "" if self.done else "every stand is needed"

    def redo(self, number: int) -> str:
        """Does a stand again, next. Returns why that can't be; "" if it could."""
        if not 1 <= number <= self.plan.stands:
            return f"the stands are 1 to {self.plan.stands}"
        if number not in self._open:
            self._open.insert(0, number)
        self._open.remove(number)
        self._open.insert(0, number)
        self._begin(Step(Kind.COME, number))
        return ""

    def view(self) -> View:
        """What a person is shown now."""
        kind, number = self.step.kind, self.step.stand
        pose = _POSE[self.plan.pose]
        come = f"Stand on the marks, face along the line, {pose}, and look ahead"
        words = {
            Kind.COME: come if number == 1 else f"Come back: {come[0].lower()}{come[1:]}",
            Kind.HOLD: "Stand still",
            Kind.WALK: "Walk about and turn, both ways, arms moving",
            Kind.DONE: "All stands are done",
        }
        lost = len(self._turned) > 0 and not bool(np.isfinite(self._turned[-1]).all())
        lack = self._fault() if kind is Kind.COME and not lost else ""
        missing = "the suit isn't measured" if lost else ""
        return View(self.step, words[kind], lack, missing, self._states(), self._bars())

    def _fault(self) -> str:
        """What is wrong with the present pose; "" for nothing."""
        if not len(self._turned) or not np.isfinite(now := self._turned[-1]).all():
            return ""
        if fault := pose_fault(now, self._segments, self.plan.pose, self._thresholds):
            return fault
        if self._first is None or self.step.stand == 1:
            return ""
        away = float(heading(product(now[0], back(self._first[0]))))
        if abs(away) <= self._thresholds.back:
            return ""
        side = "left" if away > 0 else "right"
        return f"you face {abs(np.degrees(away)):.0f} degrees {side} of the first stand, or the hips have drifted"

    def _bars(self) -> tuple[Bar, ...]:
        most, by = self._thresholds.still, self._still(self._wait)
        still = Bar("still", None, "")
        if np.isfinite(by):
            output = f"{np.degrees(by):.1f} degrees, at most {np.degrees(most):.1f}"
            still = Bar("still", min(by / (2.0 * most), 1.0), output, by <= most)
        if self.step.kind is Kind.WALK:
            gone = 0.0 if np.isnan(self._since) or not len(self._times) else self._times[-1] - self._since
            reported = [Bar("walk", min(gone / self.plan.walk, 1.0), f"{max(self.plan.walk - gone, 0.0):.0f} s left")]
        else:
            holds = self._elapsed() / self.plan.hold if self.step.kind is Kind.HOLD else float(self.done)
            reported = [Bar("held", min(holds, 1.0), f"stand {self.step.stand}" if self.step.stand else ""), still]
        if len(self._turned) and np.isfinite(self._turned[-1]).all():
            reported.append(
                Bar("hips", None, f"heading {np.degrees(float(heading(self._turned[-1, 0]))):6.1f} degrees")
            )
        return tuple(reported)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.stand and self.step.kind in (Kind.COME, Kind.HOLD):
                return "now"
            return "waiting" if number in self._open else "done"

        return tuple(state(number) for number in range(1, self.plan.stands + 1))

    @property
    def _wait(self) -> float:
        """s for which the person must be still; longer at first, as there is something to read."""
        return self.plan.read if self._first is None else self.plan.settle

    def _elapsed(self) -> float:
        return float(self._times[-1] - self._times[0]) if len(self._times) else 0.0

    def _still(self, span: float) -> float:
        """rad, by which a segment has turned in the last `span` s; infinite while that isn't known."""
        if self._elapsed() < span:
            return float("inf")
        return moved(self._turned[self._times >= self._times[-1] - span])
