"""The guided calibration of a force/torque sensor: turn it, hold it still, again and again. Pure: fed with samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.ft.fit import FEWEST, Thresholds
from srl.commissioning.calibration.ft.samples import Plan, steady
from srl.commissioning.calibration.guided import Bar
from srl.commissioning.calibration.held_still import HeldStill, Kind, still_bar
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


class Procedure(HeldStill):
    """The poses of a sensor. One begins once the sensor is still and reads unlike in all poses before."""

    things = "poses"

    def __init__(self, plan: Plan, thresholds: Thresholds, before: dict[int, Array] | None = None) -> None:
        """`before`: mean wrenches (6,) of poses of an earlier session; nothing is left to do until `redo` says so."""
        self.plan, self._thresholds = plan, thresholds
        self._forces = {number: wrench[:3] for number, wrench in (before or {}).items()}
        self.fewest = FEWEST if plan.poses > 1 else 1
        super().__init__(range(1, plan.poses + 1), before is not None, plan.settle, plan.hold, thresholds.steady)

    def _columns_of(self, samples: Any, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.wrench[own]

    def _keep(self, number: int) -> bool:
        self._forces[number] = self._columns[1][:, :3].mean(axis=0)
        return True

    def _forget(self, number: int) -> None:
        self._forces.pop(number, None)

    def _motion(self) -> float:
        """N, by which the force has changed."""
        return steady(self._recent(1))

    def instruction(self) -> Instruction:
        if self.step.kind is Kind.GO and self.plan.poses > 1:
            return Turn(_WAYS[(self.step.number - 1) % len(_WAYS)][1], (self.step.number - 1) // len(_WAYS))
        return Rest()

    def _task(self) -> str:
        if self.plan.poses == 1:
            return _ALONE
        return f"Turn the sensor: {_WAYS[(self.step.number - 1) % len(_WAYS)][0]}, about. Nothing may touch the tool"

    def _held_task(self) -> str:
        return "Hold still" if self.plan.poses > 1 else _ALONE

    def _lack(self) -> str:
        if (like := self._like()) is None:
            return ""
        return f"it reads as in pose {like}: turn it further (with a very light tool: --option poses=1)"

    def _missing(self) -> str:
        lost = len(self._times) > 0 and not bool(np.isfinite(self._columns[1]).all())
        return "the wrench isn't measured" if lost else ""

    def _bars(self) -> Sequence[Bar]:
        most, moved = self._thresholds.steady, self._moved()
        bars = [still_bar(moved, most, f"{moved:.2f} N, at most {most:g}")]
        if len(self._times):
            fx, fy, fz, tx, ty, tz = self._columns[1][-1]
            bars.append(Bar("force", None, f"{fx:7.2f} {fy:7.2f} {fz:7.2f} N"))
            bars.append(Bar("torque", None, f"{tx:7.3f} {ty:7.3f} {tz:7.3f} N m"))
        return bars

    def _like(self) -> int | None:
        """An earlier pose in which the sensor read as now; None: none, or it isn't still."""
        if not self._still():
            return None
        now = self._recent(1)[:, :3].mean(axis=0)
        gaps = {n: float(np.linalg.norm(now - f)) for n, f in self._forces.items() if n != self.step.number}
        near = min(gaps, key=lambda n: gaps[n], default=None)
        return near if near is not None and gaps[near] < self._thresholds.apart else None
