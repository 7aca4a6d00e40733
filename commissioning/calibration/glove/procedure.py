"""The guided calibration of a glove: a shape of the hand, held still, again and again. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from srl.commissioning.calibration.glove.fit import Thresholds
from srl.commissioning.calibration.glove.samples import Plan, moved
from srl.commissioning.calibration.glove.shapes import AGAIN, FINGERS, Angles, shapes
from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.held_still import HeldStill, Kind, still_bar
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Instruction, Rest, Shape


class Procedure(HeldStill):
    """The shapes of a hand. One begins once the hand is still and unlike in the shape before."""

    things = "shapes"

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
        super().__init__(tuple(self._shapes), again, plan.settle, plan.hold, thresholds.steady)

    def _columns_of(self, samples: Any, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.raw[own][:, self._own]

    @property
    def _wait(self) -> float:
        """s for which the hand must be still now; longer at first, as the person reads what to do."""
        return self.plan.read if self.step.kind is Kind.GO and self._before is None else self.plan.settle

    def _motion(self) -> float:
        """Counts, by which a sensor has changed."""
        return moved(self._recent(1))

    def _keep(self, number: int) -> bool:
        raw = self._columns[1]
        if not moved(raw) <= self._thresholds.steady:
            return False
        self._before = np.nanmean(raw, axis=0)
        return True

    def _forget(self, number: int) -> None:
        if self._earlier and AGAIN not in self._open:
            self._open.append(AGAIN)  # the glove may have been taken off since: shape 9 tells whether it sits as it did
        self._before = None

    def instruction(self) -> Instruction:
        return Shape(self._shapes[self.step.number].angles) if self.step.kind is Kind.GO else Rest()

    def _task(self) -> str:
        return self._shapes[self.step.number].task

    def _lack(self) -> str:
        return "it reads as in the shape before" if self._like() else ""

    def _missing(self) -> str:
        lost = len(self._times) > 0 and not bool(np.isfinite(self._columns[1][-1]).all())
        return "the glove isn't measured" if lost else ""

    def _bars(self) -> Sequence[Bar]:
        most, by = self._thresholds.steady, self._moved()
        bars = [still_bar(by, most, f"{by:.1f} counts, at most {most:g}")]
        if len(self._times):
            for finger in ("thumb", *FINGERS):
                own = [i for i, name in enumerate(self._sensors) if name.startswith(f"{finger}_")]
                counts = " ".join("  ?" if np.isnan(v) else f"{v:3.0f}" for v in self._columns[1][-1, own])
                bars.append(Bar(finger, None, counts))
        return bars

    def _like(self) -> bool:
        """Whether the hand is still, and as in the shape before."""
        if self._before is None or not self._still():
            return False
        return bool(np.abs(np.nanmean(self._recent(1), axis=0) - self._before).max() < self._thresholds.differs)
