"""Giving goals: the packets of a command, and which motors get torque with it.

A motor gets torque with its first goal, which must be near its present position.
"""

from __future__ import annotations

import numpy as np

from srl.drivers.servo_bus.faults import BEYOND, FAR, Faults
from srl.drivers.servo_bus.units import Units
from srl.runtime.contracts.signals import Array, Kind


class Goals:
    """The goals of one connection.

    Attributes:
        powered: whether each motor has torque, as far as is known, in the profile's order.
        newest: the newest goals that were sent, as packets; empty before the first.
    """

    def __init__(self, units: Units, faults: Faults, kind: Kind) -> None:
        """`kind`: what the goals are."""
        config = units.config
        self._units, self._faults, self._kind = units, faults, kind
        self._tolerance = config.start_tolerance * np.abs([motor.scale for motor in config.motors.values()])
        self.powered = [False] * len(config.motors)
        self.newest = b""

    def packets(self, command: Array, position: Array, away: set[int]) -> tuple[bytes, list[int]]:
        """Returns the command as packets (goals, torque on with a motor's first goal), and these motors' numbers.

        Without a first goal yet there is none. A motor whose first goal is too far becomes a fault.

        Args:
            command: (n,), as the profile has it.
            position: (n,), rad or m.
            away: ids of motors that can't be reached now.
        """
        if not (self.newest or np.isfinite(command).all()):
            return b"", []
        goals = self._units.encode(command)
        if all(self.powered):
            return goals, []
        waking = self._waking(command, position, away)
        powered = np.array(self.powered)
        powered[waking] = True
        goals = self._units.again(powered) if powered.any() else b""
        if waking:
            goals += self._units.frame("torque_enable", 1, [self._units.ids[i] for i in waking])
        return goals, waking

    def _waking(self, command: Array, position: Array, away: set[int]) -> list[int]:
        """Returns the motors that may get torque now."""
        # A non-finite value counts as too far. The bounded goal counts: beyond its limits a servo would jump to them.
        near = np.abs(self._units.bounded(command) - position) <= self._tolerance
        waking = []
        for i, id in enumerate(self._units.ids):
            if self.powered[i] or self._faults.concerns(i) or id in away:
                continue
            if near[i] or self._kind is not Kind.POSITION:
                waking.append(i)
            else:
                self._faults.far[i] = BEYOND if abs(command[i] - position[i]) <= self._tolerance[i] else FAR
        return waking

    def left(self, goals: bytes, waking: list[int], command: Array, sent: Array) -> None:
        """Notes that these packets have left, and in `sent` their values: of motors with torque, before rounding."""
        for i in waking:
            self.powered[i] = True
        self.newest = goals
        np.copyto(sent, self._units.bounded(command), where=np.array(self.powered) & np.isfinite(command))
