"""What whoever uses a worn arm feels: how long it stands still, how it jerks, and whether it could have been there."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.skeleton.body_clearance import BodyClearance
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Array
from srl.runtime.guard import CommandGuard
from srl.studies.human_srl.setting import Setting

EVERY: Final = 10  # cycles between two looks at a goal
_STILL: Final = 0.05  # of a joint's greatest speed: slower, the arm stands still for whoever looks on


class Comfort:
    """Watches a trial cycle by cycle; changes nothing.

    Attributes:
        stands: s, the longest time that the arm stood still.
    """

    def __init__(self, clearance: BodyClearance, guard: CommandGuard, setting: Setting) -> None:
        self._clearance, self._verified, self._setting = clearance, guard.verified, setting
        self._open: dict[int, list[bool]] = {}
        self._tips: list[Array] = []
        self._stood, self.stands = 0.0, 0.0
        self._last: Array | None = None

    def take(self, cycle: int, goal: Array, which: int, measured: Array) -> None:
        """A cycle: the goal and its number, and where the arm is."""
        setting = self._setting
        if self._last is not None:
            still = (np.abs(measured - self._last) < _STILL * setting.velocity * setting.dt).all()
            self._stood = self._stood + setting.dt if still else 0.0
            self.stands = max(self.stands, self._stood)
        self._last = measured.copy()
        self._tips.append(link_nodes(setting.arms.arms, self._clearance.options.arm, measured[None])[0, -1])
        if self._verified is not None and cycle % EVERY == 0:
            self._open.setdefault(which, []).append(self._rests(goal))

    def _rests(self, goal: Array) -> bool:
        """Whether the clearance would let an arm be at the goal, at rest, and move on from there at once."""
        verified, clearance, n = self._verified, self._clearance, len(goal)
        assert verified is not None
        until = np.array([verified.lag, verified.lag + verified.timeout])
        if not verified.usable:
            return False
        clearance.clear(Braking(np.array([goal, goal]), until, np.zeros(n), self._setting.tracking))
        return bool(clearance.margin >= 0.0)

    def open(self, goals: int) -> list[float]:
        """Of each of the first goals the share of the looks in which the arm could rest there."""
        return [round(float(np.mean(self._open[k])), 4) for k in range(goals) if k in self._open]

    def jerk(self) -> float:
        """m/s^3 rms, of the tip in the frame of what carries the arm."""
        if len(self._tips) < 4:
            return 0.0
        third = np.diff(np.array(self._tips), 3, axis=0) / self._setting.dt**3
        return float(np.sqrt((third**2).sum(axis=1).mean()))
