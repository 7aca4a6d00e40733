"""The guided calibration of a suit: stand, walk about, come back and stand the same way. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.held_still import HeldStill, Kind, Step, still_bar
from srl.commissioning.calibration.suit.fit import Thresholds, pose_fault
from srl.commissioning.calibration.suit.samples import Plan, moved
from srl.commissioning.calibration.suit.segments import back, heading, in_world, mean, product
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest, Return, Walk

_POSE = {"n": "arms hanging, palms to the thighs", "t": "arms straight out, palms down"}


class Procedure(HeldStill):
    """The stands of a person. One begins once the person is still, in the pose, and faces ahead; walks lie between."""

    things = "stands"

    def __init__(self, segments: Sequence[str], parents: Sequence[int], plan: Plan, thresholds: Thresholds) -> None:
        self.plan, self._thresholds = plan, thresholds
        self._segments, self._parents = tuple(segments), tuple(parents)
        self._first: Array | None = None  # (n, 4) of the first stand
        self._stood = False  # a stand was taken: the person walks before each further one
        super().__init__(range(1, plan.stands + 1), False, plan.settle, plan.hold, thresholds.still)

    def _next(self) -> None:
        if self._open and self._stood:
            self._begin(Step(Kind.PAUSE, self._open[0]))
        else:
            super()._next()

    def _columns_of(self, samples: Any, own: Any) -> tuple[Array, ...]:
        return samples.times[own], in_world(samples.rotation[own], self._parents)

    @property
    def _wait(self) -> float:
        """s for which the person must be still; longer at first, as there is something to read."""
        return self.plan.read if self._first is None and self.step.kind is not Kind.HOLD else self.plan.settle

    def _motion(self) -> float:
        """rad, by which a segment has turned."""
        return moved(self._recent(1))

    def _pause(self) -> None:
        if self._times[-1] - self._since >= self.plan.walk:
            self._go(self.step.number)

    def _keep(self, number: int) -> bool:
        turned = self._columns[1]
        if moved(turned) > self._thresholds.still:
            return False
        if number == 1:
            self._first = mean(turned)
        self._stood = True
        return True

    def instruction(self) -> Instruction:
        if self.step.kind is Kind.PAUSE:
            return Walk()
        return Return() if self.step.kind is Kind.GO else Rest()

    def go_on(self) -> str:
        if self.step.kind is Kind.PAUSE:
            self._go(self.step.number)
            return ""
        if self.step.kind is Kind.GO:
            return "it begins by itself, once you stand still in the pose"
        return f"stand still for {self.plan.hold:g} s" if self.step.kind is Kind.HOLD else ""

    def _task(self) -> str:
        if self.step.kind is Kind.PAUSE:
            return "Walk about and turn, both ways, arms moving"
        come = f"Stand on the marks, face along the line, {_POSE[self.plan.pose]}, and look ahead"
        return come if self.step.number == 1 else f"Come back: {come[0].lower()}{come[1:]}"

    def _held_task(self) -> str:
        return "Stand still"

    def _lack(self) -> str:
        return "" if self._missing() else self._fault()

    def _missing(self) -> str:
        lost = len(self._times) > 0 and not bool(np.isfinite(self._columns[1][-1]).all())
        return "the suit isn't measured" if lost else ""

    def _fault(self) -> str:
        """What is wrong with the present pose; "" for nothing."""
        if not len(self._times) or not np.isfinite(now := self._columns[1][-1]).all():
            return ""
        if fault := pose_fault(now, self._segments, self.plan.pose, self._thresholds):
            return fault
        if self._first is None or self.step.number == 1:
            return ""
        away = float(heading(product(now[0], back(self._first[0]))))
        if abs(away) <= self._thresholds.back:
            return ""
        side = "left" if away > 0 else "right"
        return f"you face {abs(np.degrees(away)):.0f} degrees {side} of the first stand, or the hips have drifted"

    def _bars(self) -> Sequence[Bar]:
        most, by = self._thresholds.still, self._moved()
        bars = [still_bar(by, most, f"{np.degrees(by):.1f} degrees, at most {np.degrees(most):.1f}")]
        if self.step.kind is Kind.PAUSE:
            gone = self._times[-1] - self._since if len(self._times) else 0.0
            bars = [Bar("walk", min(gone / self.plan.walk, 1.0), f"{max(self.plan.walk - gone, 0.0):.0f} s left")]
        if len(self._times) and not self._missing():
            hips = np.degrees(float(heading(self._columns[1][-1, 0])))
            bars.append(Bar("hips", None, f"heading {hips:6.1f} degrees"))
        return bars
