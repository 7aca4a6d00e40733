"""The guided calibration of a frame: go to a place, hold still, again and again. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Final

import numpy as np

from srl.commissioning.calibration.frames.fit import FEWEST, Thresholds, like
from srl.commissioning.calibration.frames.samples import Plan, mean, steady, tip
from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.held_still import HeldStill, Kind, still_bar
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Lead, Rest

_TIMEOUT: Final = 10.0  # s at a place that is like one before


class Procedure(HeldStill):
    """The poses, or points, of a frame. One begins once all is still, and unlike in all before."""

    _NOT_SEEN: ClassVar = "what is measured in the {} isn't seen"

    def __init__(self, plan: Plan, thresholds: Thresholds, before: dict[int, Array] | None = None) -> None:
        """`before`: mean poses (7,) in the parent of an earlier session; nothing is left to do until `redo` says so."""
        self.plan, self._thresholds, self.things = plan, thresholds, plan.what
        self._poses = {number: self._place(pose[None]) for number, pose in (before or {}).items()}
        self.fewest = FEWEST[plan.what]
        super().__init__(range(1, plan.count + 1), before is not None, plan.settle, plan.hold, thresholds.steady)

    def _columns_of(self, samples: Any, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.parent[own], samples.frame[own]

    def _ready(self) -> bool:
        if self._like() is None:
            return True
        if self._times[-1] > self._since + _TIMEOUT:  # who stays at such a place is instructed again
            self._go(self.step.number)
        return False

    def _keep(self, number: int) -> bool:
        parent = self._columns[1]
        if not np.isfinite(parent).all():
            return False
        self._poses[number] = self._place(parent)
        return True

    def _forget(self, number: int) -> None:
        self._poses.pop(number, None)

    def _motion(self) -> float:
        """m, by which either has moved."""
        return max(map(steady, (self._recent(1), self._recent(2)), self.plan.levers(self._thresholds)))

    def instruction(self) -> Instruction:
        return Lead(self.step.number) if self.step.kind is Kind.GO else Rest()

    def _task(self) -> str:
        if self.plan.what == "poses":
            return "Bring both bodies to another pose, turned about another axis, too, and hold them still"
        if not self.plan.known:
            return "Touch another point with the tip, far from those before and not on a line with them"
        x, y, z = self.plan.known[self.step.number - 1]
        return f"Touch point {self.step.number} with the tip: {x:g} {y:g} {z:g} m in the frame"

    def _lack(self) -> str:
        near = self._like()
        return "" if near is None else f"it is like {self.things[:-1]} {near[0]} ({near[1]}): go further"

    def _missing(self) -> str:
        for name, poses in zip(("parent", "frame"), self._columns[1:], strict=False):
            if len(poses) and not np.isfinite(poses[-1]).all():
                return self._NOT_SEEN.format(name)
        return ""

    def _bars(self) -> Sequence[Bar]:
        most, moved = self._thresholds.steady, self._moved()
        bars = [still_bar(moved, most, f"{1000 * moved:.1f} mm, at most {1000 * most:g}")]
        for name, poses in zip(("in parent", "in frame"), self._columns[1:], strict=False):
            if len(poses):
                x, y, z = poses[-1][:3]
                bars.append(Bar(name, None, f"{x:8.4f} {y:8.4f} {z:8.4f} m"))
        return bars

    def _place(self, poses: Array) -> Array:
        """(7,) what is compared with others: the mean of poses (T, 7), of points at the tip."""
        found = mean(poses)
        if self.plan.what == "points":
            found[:3] = tip(found[None], self.plan.parent_tip)[0]
        return found

    def _like(self) -> tuple[int, str] | None:
        """An earlier one that is as now, and by how little it differs; None: none, or it isn't still."""
        if not self._still():
            return None
        now = self._place(self._recent(1))
        for number, pose in self._poses.items():
            if number != self.step.number and (gap := like(self.plan.what, now, pose, self._thresholds)):
                return number, gap
        return None
