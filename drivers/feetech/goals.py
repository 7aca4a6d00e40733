"""Giving goals to Feetech servos. Torque comes only after the servo was seen to have stored a goal where it stands.

With torque on, a servo drives to its stored goal at once and at full speed. A goal that was lost on the wire would be
an older one, anywhere. So a motor first gets its goal without torque, and the next check reads the goal back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from srl.drivers.feetech.units import FeetechUnits
from srl.drivers.servo_bus.faults import Faults
from srl.drivers.servo_bus.goals import Goals
from srl.drivers.servo_bus.models import PER_COUNT
from srl.runtime.contracts.signals import Array, Kind


class StoredGoals(Goals):
    """The goals of one connection.

    Attributes:
        stored: (n,), counts, the goals that the servos were last seen to have stored; NaN: not seen.
        waiting: motors have a goal, and no torque yet until it is read back.
        held: the newest goals alone, as a packet: what a stop frame repeats.
    """

    def __init__(self, units: FeetechUnits, faults: Faults) -> None:
        super().__init__(units, faults, Kind.POSITION)
        self._units = units
        self._reach = units.config.start_tolerance / PER_COUNT  # counts
        self.stored = np.full(len(units.ids), np.nan)
        self.waiting = False
        self.held = b""
        self._next = b""

    def packets(self, command: Array, position: Array, away: set[int]) -> tuple[bytes, list[int]]:
        units = self._units
        if units.seen is None or not (self.newest or np.isfinite(command).all()):
            return b"", []
        goals = units.encode(command)
        self._next, self.waiting = goals, False
        if all(self.powered):
            return goals, []
        near = self._waking(command, position, away)
        ready = [i for i in near if abs(self.stored[i] - units.seen[i]) <= self._reach]
        self.waiting = len(ready) < len(near)
        commanded = np.array(self.powered)
        commanded[near] = True
        goals = units.again(commanded) if commanded.any() else b""
        self._next = goals
        if ready:
            goals += units.frame("torque_enable", 1, [units.ids[i] for i in ready])
        return goals, ready

    def drop(self, motors: Sequence[int]) -> None:
        """These motors lose their torque: no stop frame repeats their goals, which may be turns away by now."""
        for i in motors:
            self.powered[i] = False
            self.stored[i] = np.nan
        if self.held:
            powered = np.array(self.powered)
            self.held = self._units.again(powered) if powered.any() else b""

    def left(self, goals: bytes, waking: list[int], command: Array, sent: Array) -> None:
        super().left(goals, waking, command, sent)
        self.held = self._next
        self.stored[waking] = np.nan
