"""The guard of intensities: what the wearer feels, 0 to 1."""

from __future__ import annotations

from math import exp, isfinite

import numpy as np

from srl.runtime.contracts.cue import FELT, Cue
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array, Limits, Stop
from srl.runtime.guard.base import LARGEST, CommandGuard
from srl.runtime.guard.limits import INTENSITY, LEAST_DUTY

WINDOW = 10.0  # s, the time constant of the mean that `duty` bounds
PAUSE = 0.5  # s at 0 that end an `on_time`
LEAD = 0.25  # s at 0 before a cue, so that it is felt for itself
RESERVE = 1.25  # of `duty`, for the cue of a stop


class IntensityGuard(CommandGuard):
    """Limits a level, its rise, the time without a pause, and the mean. It falls at once.

    The nearer its mean is to `duty`, the nearer to `duty` is the level that an element may have: so a contact that
    lasts fades, and is felt until `on_time`. The mean is remembered through stops and resets, as skin and motor do:
    with what was sent where that is more, and for as long as the cycle really took. It never goes above `duty`, nor
    with cues above 1.25 `duty`, in cycles of up to 2.2 s (-10 ln(1 - duty) s).

    A stop of any category is off at once. A cue that the profile wants then follows after a pause, once.

    Attributes:
        stop_cue, loss_cue: given when the limb stops, and when it stops as what it follows is lost; None for none.
    """

    needs = INTENSITY
    may_be_zero = ()

    def _prepare(self, limits: Limits) -> None:
        self._most, self._rise, self._on_time, self._duty = (
            self._flat(name, getattr(limits, name), 0.0) for name in INTENSITY
        )
        for name, values, low in (("level", self._most, 0.0), ("duty", self._duty, LEAST_DUTY)):
            if not all(low <= value <= 1.0 for value in values):
                problem = f"the {name} of an intensity is {values}: it must be from {low:g} to 1"
                raise WiringError(self.place, problem, "Correct it in the profile, or in the device's driver")
        self.stop_cue: Cue | None = None
        self.loss_cue: Cue | None = None
        self._on, self._off = [0.0] * self.size, [PAUSE] * self.size  # s that it is on, less shorter pauses; at 0
        self._mean, self._had = [0.0] * self.size, [0.0] * self.size  # _had: since the last cycle, as it was applied
        self._cue: Cue | None = None
        self._since = 0.0  # s since the stop began

    def take_cues(self, stop: Cue | None, loss: Cue | None) -> None:
        """The cues of the profile; None for none.

        Raises:
            WiringError: one of them wouldn't be felt pulse for pulse, in these cycles or within these limits.
        """
        for place, cue in ((f"{self.place}.stop_cue", stop), (f"{self.place}.loss_cue", loss)):
            if cue is None:
                continue
            if problem := cue.too_short(self.dt):
                raise WiringError(place, problem, f"Give `on` and `off` {2 * self.dt:g} s at least")
            reached = min(cue.level, *self._most, *(rate * cue.on for rate in self._rise))
            if reached < FELT:
                problem = f"its pulses reach {reached:g} of full intensity, too little to feel; {FELT:g} is the least"
                raise WiringError(place, problem, f"Raise the level or level_rate of {self.place}")
        self.stop_cue, self.loss_cue = stop, loss

    def announce(self, loss: bool) -> None:
        """The limb begins to stop; `loss`: as what it follows is lost."""
        self._cue, self._since = self.loss_cue if loss and self.loss_cue is not None else self.stop_cue, 0.0

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._cue, self._on = None, [0.0] * self.size  # it has been off since the stop began, but for the cue
        self.applied[:] = 0.0

    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self.applied.flat[i] = sent[i]

    def step(self, desired: Array, desired_velocity: Array | None, dt: float) -> None:
        """As every guard's; an element that isn't finite is off by itself, and the others go on."""
        known = np.isfinite(desired)
        super().step(np.clip(np.where(known, desired, 0.0), -LARGEST, LARGEST), None, dt)
        if not known.all():
            self.rejected = True
            self.rejections += 1

    def idle(self, dt: float) -> None:
        """A cycle in which the device isn't commanded, and is off. dt: s since the last cycle."""
        self._charge([0.0] * self.size, dt)

    def _span(self, dt: float) -> float:
        """Charges what the elements have had since the cycle before, however long that was."""
        sent = self._had if self._sent is None else self._sent.ravel().tolist()
        self._charge([max(h, s) if isfinite(s) else h for h, s in zip(self._had, sent, strict=True)], dt)
        return super()._span(dt)

    def _charge(self, levels: list[float], dt: float) -> None:
        for i, level in enumerate(levels):
            self._mean[i] += (level - self._mean[i]) * (1.0 - exp(-dt / WINDOW))
            self._off[i] = 0.0 if level > 0.0 else self._off[i] + dt
            self._on[i] = 0.0 if self._off[i] >= PAUSE else self._on[i] + dt * (level > 0.0)
        self._had = [0.0] * self.size

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        self._go(desired, dt)

    def _go(self, wanted: list[float], dt: float, cue: bool = False) -> None:
        """Applies what the limits let be of a level. A cue is short, and has a reserve of its own."""
        before = self.applied.ravel().tolist()
        for i, (want, level) in enumerate(zip(wanted, before, strict=True)):
            duty = min(RESERVE * self._duty[i], 1.0) if cue else self._duty[i]
            fades = 1.0 - (1.0 - duty) * min(self._mean[i] / duty, 1.0)  # 1 after a rest, duty once the mean is that
            over = not cue and self._on[i] + dt > self._on_time[i]
            most = 0.0 if over else min(self._most[i], fades, level + self._rise[i] * dt)
            self.applied.flat[i] = self._had[i] = min(max(want, 0.0), most)

    def _halt(self, category: Stop, dt: float) -> None:
        level = self._cue.at(self._since - LEAD) if self._cue is not None else 0.0
        self._since += dt
        self._go([level] * self.size, dt, cue=True)
        self.at_rest = True
