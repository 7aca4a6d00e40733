"""The guided calibration of a force/torque sensor: turn it, hold it still, again and again. Pure: fed with samples."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final

import numpy as np

from srl.commissioning.calibration.ft import samples as marks
from srl.commissioning.calibration.ft.fit import FEWEST, Thresholds
from srl.commissioning.calibration.ft.samples import Plan, Samples, steady
from srl.commissioning.calibration.guided import Bar
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest, Turn

_WAYS: Final[tuple[tuple[str, Vector], ...]] = (
    ("its z axis up", (0.0, 0.0, 1.0)),
    ("its z axis down", (0.0, 0.0, -1.0)),
    ("its x axis up", (1.0, 0.0, 0.0)),
    ("its x axis down", (-1.0, 0.0, 0.0)),
    ("its y axis up", (0.0, 1.0, 0.0)),
    ("its y axis down", (0.0, -1.0, 0.0)),
    ("upright, askew towards x and y", (0.6, 0.6, 0.6)),
    ("upside down, askew towards x and y", (0.6, 0.6, -0.6)),
)
_ALONE: Final = "Let go of the tool: nothing may touch it"


class Kind(Enum):
    """Kind of a step."""

    TURN = "turn"
    HOLD = "hold"
    LEAVE = "leave out"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `pose` counts from 1."""

    kind: Kind
    pose: int

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        return {Kind.HOLD: self.pose, Kind.LEAVE: marks.LEFT_OUT + self.pose}.get(self.kind, marks.IDLE)


@dataclass(frozen=True)
class View:
    """What a person is shown. Attributes as in `srl.commissioning.calibration.guided.View`; `reported`: the bars."""

    step: Step
    task: str
    lack: str
    missing: str
    states: tuple[str, ...]
    reported: tuple[Bar, ...]
    things: ClassVar[str] = "poses"

    def bars(self) -> tuple[Bar, ...]:
        """How far it is."""
        return self.reported


class Procedure:
    """Goes from step to step as samples come. A pose begins once the sensor is still and unlike in all poses before.

    Attributes:
        step: the present step.
    """

    def __init__(self, plan: Plan, thresholds: Thresholds, before: dict[int, Array] | None = None) -> None:
        """`before`: mean wrenches (6,) of poses of an earlier session; nothing is left to do until `redo` says so."""
        self.plan, self._thresholds = plan, thresholds
        self._forces = {number: wrench[:3] for number, wrench in (before or {}).items()}
        self._out: set[int] = set()
        self._open = [] if before is not None else list(range(1, plan.poses + 1))
        self._next()

    def _next(self) -> None:
        self._begin(Step(Kind.TURN, self._open[0]) if self._open else Step(Kind.DONE, 0))

    def _begin(self, step: Step) -> None:
        self.step = step
        self._times, self._wrench = np.empty(0), np.empty((0, 6))

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        return self.step.kind is Kind.DONE

    def feed(self, samples: Samples) -> None:
        """Takes new samples; those that bear another mark than the step's don't count."""
        own = samples.marks == self.step.mark
        if not own.any() or self.done:
            return
        if self.step.kind is Kind.LEAVE:
            self._next()
            return
        self._times = np.concatenate([self._times, samples.times[own]])
        self._wrench = np.concatenate([self._wrench, samples.wrench[own]])
        if self.step.kind is Kind.TURN:
            if self._still() <= self._thresholds.steady and self._like() is None:
                self._begin(Step(Kind.HOLD, self.step.pose))
        elif self._elapsed() >= self.plan.settle and self._still() > self._thresholds.steady:
            self._begin(Step(Kind.TURN, self.step.pose))  # it was moved: its samples are too few, so they don't count
        elif self._elapsed() >= self.plan.hold:
            self._take()

    def _take(self) -> None:
        self._forces[self.step.pose] = self._wrench[:, :3].mean(axis=0)
        self._out.discard(self.step.pose)
        self._open.remove(self.step.pose)
        self._next()

    def instruction(self) -> Instruction:
        """What whoever simulates the person is told at the present step."""
        if self.step.kind is Kind.TURN and self.plan.poses > 1:
            return Turn(_WAYS[(self.step.pose - 1) % len(_WAYS)][1], (self.step.pose - 1) // len(_WAYS))
        return Rest()

    def go_on(self) -> str:
        """Takes the pose as it is now. Returns why that can't be; "" if it could."""
        if self.step.kind is Kind.HOLD:
            return f"hold it still for {self.plan.hold:g} s"
        if self.step.kind is Kind.TURN:
            self._begin(Step(Kind.HOLD, self.step.pose))
        return ""

    def skip(self) -> str:
        """Leaves the present pose out. Returns why that can't be; "" if it could."""
        if self.step.kind not in (Kind.TURN, Kind.HOLD):
            return ""
        pose, fewest = self.step.pose, FEWEST if self.plan.poses > 1 else 1
        if self.plan.poses - len(self._out | {pose}) < fewest:
            return f"{fewest} poses must remain"
        self._out.add(pose)
        self._forces.pop(pose, None)
        self._open.remove(pose)
        self._begin(Step(Kind.LEAVE, pose))
        return ""

    def redo(self, number: int) -> str:
        """Does a pose again, next. Returns why that can't be; "" if it could."""
        if not 1 <= number <= self.plan.poses:
            return f"the poses are 1 to {self.plan.poses}"
        if number in self._open:
            self._open.remove(number)
        self._open.insert(0, number)
        self._forces.pop(number, None)
        self._out.discard(number)
        self._begin(Step(Kind.TURN, number))
        return ""

    def view(self) -> View:
        """What a person is shown now."""
        step = self.step
        turn = f"Turn the sensor: {_WAYS[(step.pose - 1) % len(_WAYS)][0]}, about. Nothing may touch the tool"
        words = {
            Kind.TURN: turn if self.plan.poses > 1 else _ALONE,
            Kind.HOLD: "Hold still" if self.plan.poses > 1 else _ALONE,
            Kind.LEAVE: f"Pose {step.pose} is left out",
            Kind.DONE: "All poses are done",
        }
        moved, like = self._still(), self._like()
        lack = ""
        if step.kind is Kind.TURN and like is not None:
            lack = f"it reads as in pose {like}: turn it further (with a very light tool: --option poses=1)"
        lost = len(self._wrench) > 0 and not bool(np.isfinite(self._wrench).all())
        return View(
            step, words[step.kind], lack, "the wrench isn't measured" if lost else "", self._states(),
            self._bars(moved),
        )  # fmt: skip

    def _bars(self, moved: float) -> tuple[Bar, ...]:
        most = self._thresholds.steady
        still = Bar("still", None, "")
        if np.isfinite(moved):
            still = Bar("still", min(moved / (2.0 * most), 1.0), f"{moved:.2f} N, at most {most:g}", moved <= most)
        held = self._elapsed() / self.plan.hold if self.step.kind is Kind.HOLD else float(self.done)
        reported = [Bar("held", min(held, 1.0), f"pose {self.step.pose}" if self.step.pose else ""), still]
        if len(self._wrench):
            fx, fy, fz, tx, ty, tz = self._wrench[-1]
            reported.append(Bar("force", None, f"{fx:7.2f} {fy:7.2f} {fz:7.2f} N"))
            reported.append(Bar("torque", None, f"{tx:7.3f} {ty:7.3f} {tz:7.3f} N m"))
        return tuple(reported)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.pose and not self.done:
                return "now"
            if number in self._out:
                return "left out"
            return "waiting" if number in self._open else "done"

        return tuple(state(number) for number in range(1, self.plan.poses + 1))

    def _elapsed(self) -> float:
        return float(self._times[-1] - self._times[0]) if len(self._times) else 0.0

    def _still(self) -> float:
        """N, by which the force has changed lately; infinite while that isn't known."""
        if self._elapsed() < self.plan.settle:
            return float("inf")
        return steady(self._wrench[self._times >= self._times[-1] - self.plan.settle])

    def _like(self) -> int | None:
        """An earlier pose in which the sensor read as now; None: none, or it isn't still."""
        if self._still() > self._thresholds.steady:
            return None
        now = self._wrench[self._times >= self._times[-1] - self.plan.settle, :3].mean(axis=0)
        gaps = {n: float(np.linalg.norm(now - f)) for n, f in self._forces.items() if n != self.step.pose}
        near = min(gaps, key=lambda n: gaps[n], default=None)
        return near if near is not None and gaps[near] < self._thresholds.apart else None
