"""The guided calibration of a glove: a shape of the hand, held still, again and again. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from srl.commissioning.calibration.glove.fit import Thresholds
from srl.commissioning.calibration.glove.samples import IDLE, Plan, Samples, moved
from srl.commissioning.calibration.glove.shapes import AGAIN, FINGERS, Angles, shapes
from srl.commissioning.calibration.guided import Bar
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest
from srl.runtime.contracts.wearer import Shape as Told


class Kind(Enum):
    """Kind of a step."""

    SHAPE = "shape"
    HOLD = "hold"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `shape` counts from 1."""

    kind: Kind
    shape: int

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return self.shape if self.kind is Kind.HOLD else IDLE


@dataclass(frozen=True)
class View:
    """What a person is shown. Attributes as in `srl.commissioning.calibration.guided.View`; `reported`: the bars."""

    step: Step
    task: str
    lack: str
    missing: str
    states: tuple[str, ...]
    reported: tuple[Bar, ...]
    things: ClassVar[str] = "shapes"

    def bars(self) -> tuple[Bar, ...]:
        """How far it is."""
        return self.reported


class Procedure:
    """Goes from step to step as samples come. A shape begins once the hand is still and unlike in the shape before.

    Attributes:
        step: the present step.
    """

    def __init__(
        self, sensors: Sequence[str], plan: Plan, known: Angles, thresholds: Thresholds, again: bool = False
    ) -> None:
        """`sensors`: names of all. `again`: of an earlier time; nothing is left to do until `redo` says so."""
        self._earlier = again
        self.plan, self._thresholds, self._shapes = plan, thresholds, shapes(known)
        # A broken sensor that isn't calibrated must not look as if the hand moved.
        self._own = [i for i, name in enumerate(sensors) if name not in plan.left]
        self._sensors = tuple(sensors[i] for i in self._own)
        self._before: Array | None = None  # (n,) of the shape that was held last
        self._open = [] if again else list(self._shapes)
        self._next()

    def _next(self) -> None:
        self._begin(Step(Kind.SHAPE, self._open[0]) if self._open else Step(Kind.DONE, 0))

    def _begin(self, step: Step) -> None:
        self.step = step
        self._times, self._raw = np.empty(0), np.empty((0, len(self._sensors)))

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return self.step.kind is Kind.DONE

    def feed(self, samples: Samples) -> None:
        """Takes new samples; those that bear another mark than the step's don't count."""
        own = samples.marks == self.step.mark
        if not own.any() or self.done:
            return
        self._times = np.concatenate([self._times, samples.times[own]])
        self._raw = np.concatenate([self._raw, samples.raw[own][:, self._own]])
        steady = self._thresholds.steady
        if self.step.kind is Kind.SHAPE:
            recent = self._times >= self._times[-1] - 2.0 * self._wait  # a person may take minutes: no more is needed
            self._times, self._raw = self._times[recent], self._raw[recent]
            if self._still(self._wait) <= steady and not self._like():
                self._begin(Step(Kind.HOLD, self.step.shape))
        elif self._elapsed() >= self.plan.settle and self._still(self.plan.settle) > steady:
            self._begin(Step(Kind.SHAPE, self.step.shape))  # it moved: its samples are too few, so they don't count
        elif self._elapsed() >= self.plan.hold:
            if moved(self._raw) <= steady:
                self._take()
            else:
                self._begin(Step(Kind.SHAPE, self.step.shape))

    def _take(self) -> None:
        self._before = np.nanmean(self._raw, axis=0)
        self._open.remove(self.step.shape)
        self._next()

    def instruction(self) -> Instruction:
        """What whoever simulates the person is told at the present step."""
        return Told(self._shapes[self.step.shape].angles) if self.step.kind is Kind.SHAPE else Rest()

    def go_on(self) -> str:
        """Takes the shape as it is now. Returns why that can't be; "" if it could."""
        if self.step.kind is Kind.HOLD:
            return f"hold it still for {self.plan.hold:g} s"
        if self.step.kind is Kind.SHAPE:
            self._begin(Step(Kind.HOLD, self.step.shape))
        return ""

    def skip(self) -> str:
        """Leaves nothing out: each shape is needed."""
        return "" if self.done else "every shape is needed"

    def redo(self, number: int) -> str:
        """Does a shape again, next. Returns why that can't be; "" if it could."""
        if number not in self._shapes:
            return f"the shapes are 1 to {len(self._shapes)}"
        if number in self._open:
            self._open.remove(number)
        self._open.insert(0, number)
        if self._earlier and AGAIN not in self._open:
            self._open.append(AGAIN)  # the glove may have been taken off since: shape 9 tells whether it sits as it did
        self._before = None
        self._begin(Step(Kind.SHAPE, number))
        return ""

    def view(self) -> View:
        """What a person is shown now."""
        kind, shape = self.step.kind, self._shapes.get(self.step.shape)
        task = "All shapes are done" if shape is None else "Hold still" if kind is Kind.HOLD else shape.task
        lack = "it reads as in the shape before" if kind is Kind.SHAPE and self._like() else ""
        lost = len(self._raw) > 0 and not bool(np.isfinite(self._raw[-1]).all())
        missing = "the glove isn't measured" if lost else ""
        return View(self.step, task, lack, missing, self._states(), self._bars())

    def _bars(self) -> tuple[Bar, ...]:
        most, by = self._thresholds.steady, self._still(self._wait)
        still = Bar("still", None, "")
        if np.isfinite(by):
            still = Bar("still", min(by / (2.0 * most), 1.0), f"{by:.1f} counts, at most {most:g}", by <= most)
        holds = self._elapsed() / self.plan.hold if self.step.kind is Kind.HOLD else float(self.done)
        reported = [Bar("held", min(holds, 1.0), f"shape {self.step.shape}" if self.step.shape else ""), still]
        if len(self._raw):
            for finger in ("thumb", *FINGERS):
                own = [i for i, name in enumerate(self._sensors) if name.startswith(f"{finger}_")]
                output = " ".join("  ?" if np.isnan(v) else f"{v:3.0f}" for v in self._raw[-1, own])
                reported.append(Bar(finger, None, output))
        return tuple(reported)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.shape and not self.done:
                return "now"
            return "waiting" if number in self._open else "done"

        return tuple(state(number) for number in self._shapes)

    @property
    def _wait(self) -> float:
        """s for which the hand must be still now; longer at first, as the person reads what to do."""
        if self.step.kind is Kind.SHAPE and self._before is None:
            return self.plan.read
        return self.plan.settle

    def _elapsed(self) -> float:
        return float(self._times[-1] - self._times[0]) if len(self._times) else 0.0

    def _still(self, span: float) -> float:
        """Counts, by which a sensor has changed in the last `span` s; infinite while that isn't known."""
        if self._elapsed() < span:
            return float("inf")
        return moved(self._raw[self._times >= self._times[-1] - span])

    def _like(self) -> bool:
        """Whether the hand is still, and as in the shape before."""
        if self._before is None or self._still(self._wait) > self._thresholds.steady:
            return False
        now = np.nanmean(self._raw[self._times >= self._times[-1] - self._wait], axis=0)
        return bool(np.abs(now - self._before).max() < self._thresholds.differs)
