"""Vibration motors on the wearer's skin, and what the wearer feels of them."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, inf, log
from typing import Final

from srl.drivers.firmata.config import MotorConfig

RISE: Final = (
    0.06  # s, time constant of a turning mass: 95 % in 180 ms (Precision Microdrives, step response of 305-000)
)
LEAST: Final = 0.03  # s that a vibration must last to be felt as one (Remache-Vinueza, Sci. Reports 15:5057, 2025)
KEPT: Final = 1000  # of each motor's onsets


class Motors:
    """Each motor's vibration follows its duty with a lag; the wearer feels what is above a share of the full one.

    A motor turns from its `start` on; its vibration is taken as proportional to the rest of the duty. The threshold is
    an assumption: it depends on the motor, the place, and how it is fixed.

    Attributes:
        onsets: by motor, ns of world time at which the wearer began to feel it.
    """

    def __init__(self, motors: Mapping[str, MotorConfig], felt_above: float) -> None:
        self._names, self._above = tuple(motors), felt_above
        self._range = [(motor.start, motor.full) for motor in motors.values()]
        n = len(self._names)
        self._aim, self._level, self._at = [0.0] * n, [0.0] * n, [0] * n
        self._since = [inf] * n  # ns, since when it is above the threshold; inf: it isn't
        self._told = [False] * n
        self.onsets: list[list[int]] = [[] for _ in range(n)]
        self._count = [0] * n

    def drive(self, motor: int, share: float, now: int) -> None:
        """A motor has this share of the supply from `now` (ns of world time) on."""
        self._advance(motor, now)
        start, full = self._range[motor]
        self._aim[motor] = min(max((share - start) / (full - start), 0.0), 1.0) if share > 0.0 else 0.0

    def off(self, now: int) -> None:
        """All motors lose their supply."""
        for motor in range(len(self._names)):
            self.drive(motor, 0.0, now)

    def levels(self, now: int) -> dict[str, float]:
        """The vibration of each motor now, 0 to 1."""
        for motor in range(len(self._names)):
            self._advance(motor, now)
        return dict(zip(self._names, self._level, strict=True))

    def metrics(self, now: int) -> dict[str, object]:
        """How often the wearer has felt each, and the vibration now; nothing where there are no motors."""
        if not self._names:
            return {}
        levels = self.levels(now)
        return {"felt": dict(zip(self._names, self._count, strict=True)), "vibration": levels}

    def _advance(self, motor: int, now: int) -> None:
        aim, level, dt = self._aim[motor], self._level[motor], (now - self._at[motor]) * 1e-9
        self._at[motor] = now
        if dt <= 0.0:
            return
        after = aim + (level - aim) * exp(-dt / RISE)
        if after <= self._above:
            if level > self._above:
                self._take(motor, now - round(1e9 * (dt - RISE * log((level - aim) / (self._above - aim)))))
            self._since[motor], self._told[motor] = inf, False
        else:
            if self._since[motor] == inf:
                waits = RISE * log((aim - level) / (aim - self._above)) if level < self._above else 0.0
                self._since[motor] = now - round(1e9 * (dt - waits))
            self._take(motor, now)
        self._level[motor] = after

    def _take(self, motor: int, until: int) -> None:
        """It was above the threshold until then."""
        felt = self._since[motor] + LEAST * 1e9
        if not self._told[motor] and until >= felt:
            self._told[motor] = True
            self._count[motor] += 1
            self.onsets[motor] = [*self.onsets[motor][1 - KEPT :], round(felt)]
