"""The steps of the guided calibration, and what a person is shown at each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np

from srl.commissioning.calibration.guided import Bar, View
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
class Progress:
    """How far a step is.

    Attributes:
        step: the present one.
        share: 0 to 1, of the step's time.
        speed: m/s, of the hand. Not finite if it isn't seen, as all others.
        distance: m, of the hand from the step's point.
        lost: share of the newest samples without angles or hand.
        kept, needed: number of samples of the trial.
        range, least_range: rad, of the trial's motion.
        box: (2, 3) m, least and greatest position explored so far; None before.
    """

    step: Step
    share: float
    speed: float
    distance: float
    lost: float
    kept: int
    needed: int
    range: float
    least_range: float
    box: Array | None

    def view(self, task: str, lack: str, states: Sequence[str]) -> View:
        """What a person is shown, with the task, what is wrong, and the state of each point."""
        missing = f"{self.lost:.0%} of the samples lack angles or hand" if self.lost > 0.0 else ""
        return View(self.step, task, lack, missing, states, self.bars(), "points")

    def bars(self) -> list[Bar]:
        """How far it is."""
        seen, slow = np.isfinite(self.speed), np.isfinite(self.speed) and self.speed < _CALM
        speed_text = f"{100 * self.speed:.1f} cm/s" if seen else "not seen"
        bars = [
            Bar("step", self.share, self.step.kind.value),
            Bar(
                "hand's speed",
                min(self.speed / 0.1, 1.0) if seen else 1.0,
                f"{speed_text}, below 5 counts as still",
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
