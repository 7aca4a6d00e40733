"""The guided calibration of a frame: go to a place, hold still, again and again. Pure: fed with samples."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final

import numpy as np

from srl.commissioning.calibration.frames import samples as marks
from srl.commissioning.calibration.frames.fit import FEWEST, Thresholds, like
from srl.commissioning.calibration.frames.samples import Plan, Samples, mean, steady, tip
from srl.commissioning.calibration.guided import Bar
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Lead, Rest

_TIMEOUT: Final = 10.0  # s at a place that is like one before


class Kind(Enum):
    """Kind of a step."""

    GO = "go"
    HOLD = "hold"
    LEAVE = "leave out"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `number` counts from 1."""

    kind: Kind
    number: int

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return {Kind.HOLD: self.number, Kind.LEAVE: marks.LEFT_OUT + self.number}.get(self.kind, marks.IDLE)


@dataclass(frozen=True)
class View:
    """What a person is shown. Attributes as in `srl.commissioning.calibration.guided.View`; `reported`: the bars."""

    step: Step
    task: str
    lack: str
    missing: str
    states: tuple[str, ...]
    reported: tuple[Bar, ...]
    things: str

    def bars(self) -> tuple[Bar, ...]:
        """How far it is."""
        return self.reported


class Procedure:
    """Goes from step to step as samples come. One is taken once all is still, and unlike in all before.

    Attributes:
        step: the present step.
    """

    _NOT_SEEN: ClassVar = "what is measured in the {} isn't seen"

    def __init__(self, plan: Plan, thresholds: Thresholds, before: dict[int, Array] | None = None) -> None:
        """`before`: mean poses (7,) in the parent of an earlier session; nothing is left to do until `redo` says so."""
        self.plan, self._thresholds = plan, thresholds
        self._poses = {number: self._place(pose[None]) for number, pose in (before or {}).items()}
        self._out: set[int] = set()
        self._open = [] if before is not None else list(range(1, plan.count + 1))
        self._one = plan.what[:-1]
        self._next()

    def _next(self) -> None:
        self._begin(Step(Kind.GO, self._open[0]) if self._open else Step(Kind.DONE, 0))

    def _begin(self, step: Step) -> None:
        self.step, self._since = step, 0.0
        self._times, self._parent, self._frame = np.empty(0), np.empty((0, 7)), np.empty((0, 7))

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return self.step.kind is Kind.DONE

    def feed(self, samples: Samples) -> None:
        """Takes new samples; those that bear another mark than the step's don't count."""
        own = samples.marks == self.step.mark
        if not own.any() or self.done:
            return
        if not len(self._times):
            self._since = float(samples.times[own][0])
        if self.step.kind is Kind.LEAVE:
            self._next()
            return
        self._times = np.concatenate([self._times, samples.times[own]])
        self._parent = np.concatenate([self._parent, samples.parent[own]])
        self._frame = np.concatenate([self._frame, samples.frame[own]])
        if self.step.kind is Kind.GO:
            self._drop_old()
            self._look()
        elif self._elapsed() >= self.plan.settle and self._still() > self._thresholds.steady:
            self._begin(Step(Kind.GO, self.step.number))  # it was moved: its samples are too few, so they don't count
        elif self._elapsed() >= self.plan.hold:
            self._take()

    def _look(self) -> None:
        """Begins to hold it once all is still and unlike in all before; who stays where it is like one is told anew."""
        if self._still() > self._thresholds.steady:
            return
        if self._like() is None:
            self._begin(Step(Kind.HOLD, self.step.number))
        elif self._times[-1] > self._since + _TIMEOUT:
            self._begin(Step(Kind.GO, self.step.number))

    def _drop_old(self) -> None:
        """Of a way of minutes only the end is looked at."""
        recent = self._times >= self._times[-1] - 2.0 * self.plan.settle
        self._times, self._parent, self._frame = self._times[recent], self._parent[recent], self._frame[recent]

    def _take(self) -> None:
        if not np.isfinite(self._parent).all():
            self._begin(Step(Kind.GO, self.step.number))
            return
        self._poses[self.step.number] = self._place(self._parent)
        self._out.discard(self.step.number)
        self._open.remove(self.step.number)
        self._next()

    def instruction(self) -> Instruction:
        """What whoever simulates the person is told at the present step."""
        return Lead(self.step.number) if self.step.kind is Kind.GO else Rest()

    def go_on(self) -> str:
        """Takes the place as it is now. Returns why that can't be; "" if it could."""
        if self.step.kind is Kind.HOLD:
            return f"hold it still for {self.plan.hold:g} s"
        if self.step.kind is Kind.GO:
            self._begin(Step(Kind.HOLD, self.step.number))
        return ""

    def skip(self) -> str:
        """Leaves the present one out. Returns why that can't be; "" if it could."""
        if self.step.kind not in (Kind.GO, Kind.HOLD):
            return ""
        number, fewest = self.step.number, FEWEST[self.plan.what]
        if self.plan.count - len(self._out | {number}) < fewest:
            return f"{fewest} {self.plan.what} must remain"
        self._out.add(number)
        self._poses.pop(number, None)
        self._open.remove(number)
        self._begin(Step(Kind.LEAVE, number))
        return ""

    def redo(self, number: int) -> str:
        """Does one again, next. Returns why that can't be; "" if it could."""
        if not 1 <= number <= self.plan.count:
            return f"the {self.plan.what} are 1 to {self.plan.count}"
        if number in self._open:
            self._open.remove(number)
        self._open.insert(0, number)
        self._poses.pop(number, None)
        self._out.discard(number)
        self._begin(Step(Kind.GO, number))
        return ""

    def view(self) -> View:
        """What a person is shown now."""
        step = self.step
        words = {
            Kind.GO: self._task(), Kind.HOLD: "Hold still",
            Kind.LEAVE: f"{self._one.capitalize()} {step.number} is left out",
            Kind.DONE: f"All {self.plan.what} are done",
        }  # fmt: skip
        near, lack = self._like(), ""
        if step.kind is Kind.GO and near is not None:
            lack = f"it is like {self._one} {near[0]} ({near[1]}): go further"
        return View(
            step, words[step.kind], lack, self._missing(), self._states(), self._bars(self._still()), self.plan.what
        )

    def _task(self) -> str:
        if self.plan.what == "poses":
            return "Bring both bodies to another pose, turned about another axis, too, and hold them still"
        if not self.plan.known:
            return "Touch another point with the tip, far from those before and not on a line with them"
        x, y, z = self.plan.known[self.step.number - 1] if self.step.number else (0.0, 0.0, 0.0)
        return f"Touch point {self.step.number} with the tip: {x:g} {y:g} {z:g} m in the frame"

    def _missing(self) -> str:
        for name, poses in (("parent", self._parent), ("frame", self._frame)):
            if len(poses) and not np.isfinite(poses[-1]).all():
                return self._NOT_SEEN.format(name)
        return ""

    def _bars(self, moved: float) -> tuple[Bar, ...]:
        most = self._thresholds.steady
        still = Bar("still", None, "")
        if np.isfinite(moved):
            text = f"{1000 * moved:.1f} mm, at most {1000 * most:g}"
            still = Bar("still", min(moved / (2.0 * most), 1.0), text, moved <= most)
        share = self._elapsed() / self.plan.hold if self.step.kind is Kind.HOLD else float(self.done)
        reported = [Bar("held", min(share, 1.0), f"{self._one} {self.step.number}" if self.step.number else ""), still]
        for name, poses in (("in parent", self._parent), ("in frame", self._frame)):
            if len(poses):
                x, y, z = poses[-1][:3]
                reported.append(Bar(name, None, f"{x:8.4f} {y:8.4f} {z:8.4f} m"))
        return tuple(reported)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.number and not self.done:
                return "now"
            if number in self._out:
                return "left out"
            return "waiting" if number in self._open else "done"

        return tuple(state(number) for number in range(1, self.plan.count + 1))

    def _elapsed(self) -> float:
        return float(self._times[-1] - self._times[0]) if len(self._times) else 0.0

    def _still(self) -> float:
        """m, by which either has moved lately; infinite while that isn't known."""
        if self._elapsed() < self.plan.settle:
            return float("inf")
        recent = self._times >= self._times[-1] - self.plan.settle
        both = (self._parent[recent], self._frame[recent])
        return max(map(steady, both, self.plan.levers(self._thresholds)))

    def _place(self, poses: Array) -> Array:
        """(7,) what is compared with others: the mean of poses (T, 7), of points at the tip."""
        found = mean(poses)
        if self.plan.what == "points":
            found[:3] = tip(found[None], self.plan.parent_tip)[0]
        return found

    def _like(self) -> tuple[int, str] | None:
        """An earlier one that is as now, and by how little it differs; None: none, or it isn't still."""
        if self._still() > self._thresholds.steady:
            return None
        now = self._place(self._parent[self._times >= self._times[-1] - self.plan.settle])
        for number, pose in self._poses.items():
            if number != self.step.number and (gap := like(self.plan.what, now, pose, self._thresholds)):
                return number, gap
        return None
