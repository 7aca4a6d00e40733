"""The steps of the guided calibration, and what a person is shown at each."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, Final

import numpy as np

from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.ikns import marks
from srl.runtime.contracts.signals import Array

_CALM: Final = 0.05  # m/s, below which a person is told that the hand is still


class Kind(Enum):
    """Kind of a step."""

    STATIC = "static"
    EXPLORATION = "exploration"
    GO = "go"
    TRIAL = "trial"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `point` and `dof`, from 0 on, in `go` and `trial`; `undone`, the mark that takes back trials before."""

    kind: Kind
    point: int = -1
    dof: int = -1
    undone: int = field(default=marks.IDLE, compare=False)

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        if self.kind is Kind.TRIAL:
            return marks.mark_of(self.point, self.dof)
        return {Kind.STATIC: marks.STATIC, Kind.EXPLORATION: marks.EXPLORATION}.get(self.kind, self.undone)


@dataclass(frozen=True)
class View:
    """What a person is shown.

    Attributes:
        step: the present one.
        task: what to do now, one sentence.
        lack: why the step isn't over, or what is wrong; "" for nothing.
        progress: 0 to 1, of the step's time.
        speed: m/s, of the hand. Not finite if it isn't seen, as all others.
        distance: m, of the hand from the step's point.
        lost: share of the newest samples without angles or hand.
        kept, needed: number of samples of the trial.
        range, least_range: rad, of the trial's motion.
        box: (2, 3) m, least and greatest position explored so far; None before.
        states: of each point: waiting, now, done, weak (with the reasons), left out.
    """

    step: Step
    task: str
    lack: str
    progress: float
    speed: float
    distance: float
    lost: float
    kept: int
    needed: int
    range: float
    least_range: float
    box: Array | None
    states: tuple[str, ...]
    things: ClassVar[str] = "points"

    @property
    def missing(self) -> str:
        """What isn't measured now; "" for nothing."""
        return f"{self.lost:.0%} of the samples lack angles or hand" if self.lost > 0.0 else ""

    def bars(self) -> list[Bar]:
        """How far it is."""
        seen, slow = np.isfinite(self.speed), np.isfinite(self.speed) and self.speed < _CALM
        output = f"{100 * self.speed:.1f} cm/s" if seen else "not seen"
        bars = [
            Bar("step", self.progress, self.step.kind.value),
            Bar(
                "hand's speed",
                min(self.speed / 0.1, 1.0) if seen else 1.0,
                f"{output}, below 5 counts as still",
                bool(slow),
            ),
        ]
        if self.step.kind in (Kind.GO, Kind.TRIAL):
            there = np.isfinite(self.distance)
            bars.append(
                Bar("hand's place", None, f"{100 * self.distance:.1f} cm from the point" if there else "not seen")
            )
        if self.step.kind is Kind.TRIAL:
            bars.append(Bar("samples kept", self.kept / self.needed, f"{self.kept} of {self.needed} needed"))
            span = f"{self.range:.2f} rad, {self.least_range} needed; more is better"
            bars.append(Bar("range", self.range / self.least_range, span))
        if self.box is not None:
            x, y, z = 100.0 * (self.box[1] - self.box[0])
            bars.append(Bar("workspace", None, f"{x:.0f} cm deep, {y:.0f} cm wide, {z:.0f} cm high"))
        return bars
