"""The index finger of a simulated wearer on a gamepad's trigger.

It reads the displayed curve and the pointer as the arm does (`srl.sim.parts.body.tracking`): the same lag, delay and
learned line. What differs is the limb: a finger against a spring, whose force is noisy in proportion to the force, and
whose motion is noisy in proportion to its speed, as the arm's.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, sqrt
from typing import Final

import numpy as np

from srl.sim.parts.body.tracking import Tracker
from srl.sim.parts.body.wearer_config import Tracking
from srl.sim.parts.person.noise import Wander
from srl.sim.wearer.motion import quintic

_NAME: Final = "trigger"
_TICK: Final = 0.005  # s, as the arm's
_EASE: Final = 1.0  # s, to the curve's beginning
_QUICK: Final = 0.1  # s, correlation time of both noises
_MUSCLES: Final = 0.04  # s, lag of the force's fluctuations: they lie below some 4 Hz
_LOUDER: Final = sqrt((_QUICK + _MUSCLES) / _QUICK)  # so that the lag doesn't lessen them
_FADE: Final = 1.0  # s, in which an error of the motion goes, as the arm's


class TriggerFinger:
    """Moves a trigger so that the pointer follows a curve."""

    def __init__(self, tracking: Tracking, *, noise: float, force_noise: float, preload: float, seed: int) -> None:
        """
        Args:
            noise: rms of the speed's error, share of the speed.
            force_noise: rms of the force's error, share of the force.
            preload: force of the released trigger's spring, share of what its whole travel adds.
        """
        self._noise, self._force_noise, self._preload = noise, force_noise, preload
        self._tracker = Tracker(tracking, seed, _NAME, _TICK)
        self._wander = Wander(seed, _NAME, _TICK, (_QUICK,) * 2)
        self._values: tuple[float, ...] = (0.0, 0.0)
        self._error, self._shake, self._number = 0.0, 0.0, 0
        self._tracker.begin(np.zeros(3), np.zeros(3), np.zeros(3), np.ones(3))
        self.deflection = 0.0

    def until(self, t: float, wanted: Callable[[float], float], pointer: float) -> float:
        """Goes on to time t, s since the beginning, and returns the trigger's deflection, 0 to 1.

        Args:
            wanted: the displayed curve, 0 to 1, over time.
            pointer: on the screen, 0 to 1.
        """
        tracker = self._tracker
        while (self._number + 1) * _TICK <= t + 1e-9:
            self._number += 1
            now = self._number * _TICK
            before = float(tracker.x[0])
            ease = quintic(min(now / _EASE, 1.0))
            tracker.follow(self._number, 0, wanted(now - tracker.reads), self.deflection, pointer, ease)
            self._values = self._wander.next(self._values, self._number)
            fast, strong = self._values
            moved = float(tracker.x[0]) - before
            self._error += self._noise * fast * moved - self._error * _TICK / _FADE
            self._shake += (1.0 - exp(-_TICK / _MUSCLES)) * (_LOUDER * strong - self._shake)
            shaky = self._force_noise * self._shake * (self._preload + float(tracker.x[0]))
            self.deflection = min(max(float(tracker.x[0]) + self._error + shaky, 0.0), 1.0)
        return self.deflection
