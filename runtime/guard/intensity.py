"""The guard of intensities: what the wearer feels, 0 to 1."""

from __future__ import annotations

from srl.runtime.contracts.cue import Cue
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Limits, Stop
from srl.runtime.guard.base import CommandGuard
from srl.runtime.guard.limits import INTENSITY

WINDOW = 10.0  # s, the time constant of the mean that `duty` bounds
PAUSE = 0.5  # s that an element is off once it was on for `on_time`
RESUMES = 0.8  # of `duty`: an element that has spent it is off until its mean has fallen to this


class IntensityGuard(CommandGuard):
    """Limits a level, its rise, the time without a pause, and the mean. It falls at once.

    A stop of any category is off at once, but for a cue that the profile wants then: some pulses within the same
    limits, once. What an element has spent is remembered through stops and resets: skin and motor do, too.

    Attributes:
        stop_cue, loss_cue: given when the limb stops, and when it stops as what it follows is lost; None for none.
    """

    needs = INTENSITY
    may_be_zero = ()

    def _prepare(self, limits: Limits) -> None:
        self._most, self._rise, self._on_time, self._duty = (
            self._flat(name, getattr(limits, name), 0.0) for name in INTENSITY
        )
        for name, values in (("level", self._most), ("duty", self._duty)):
            if (most := max(values)) > 1.0:
                raise WiringError(self.place, f"{name} {most:g} is above 1, which is all there is", "Give 1 or less")
        self.stop_cue: Cue | None = None
        self.loss_cue: Cue | None = None
        self._on = [0.0] * self.size  # s since the last pause
        self._pause = [0.0] * self.size  # s that it stays off
        self._mean = [0.0] * self.size
        self._spent = [False] * self.size
        self._cue: Cue | None = None
        self._since = 0.0  # s since the cue's begin

    def announce(self, loss: bool) -> None:
        """The limb begins to stop; `loss`: as what it follows is lost."""
        self._cue, self._since = self.loss_cue if loss and self.loss_cue is not None else self.stop_cue, 0.0

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._cue = None
        self.applied[:] = 0.0

    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self.applied.flat[i] = sent[i]

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        before = self.applied.ravel().tolist()
        for i, (wanted, level) in enumerate(zip(desired, before, strict=True)):
            self.applied.flat[i] = self._allowed(i, min(max(wanted, 0.0), level + self._rise[i] * dt), dt)

    def _allowed(self, i: int, level: float, dt: float) -> float:
        """What an element may have of a level for dt s."""
        level = min(level, self._most[i])
        self._pause[i] = max(self._pause[i] - dt, 0.0)
        self._spent[i] = self._mean[i] > (RESUMES if self._spent[i] else 1.0) * self._duty[i]
        if self._on[i] + dt > self._on_time[i]:
            self._pause[i], self._on[i] = PAUSE, 0.0
        if self._pause[i] > 0.0 or self._spent[i]:
            level = 0.0
        self._on[i] = self._on[i] + dt if level > 0.0 else 0.0
        self._mean[i] += (level - self._mean[i]) * min(dt / WINDOW, 1.0)
        return level

    def _halt(self, category: Stop, dt: float) -> None:
        level = 0.0
        if self._cue is not None:
            level = self._cue.at(self._since)
            self._since += dt
        self._follow([level] * self.size, None, dt)
        self.at_rest = True
