"""A vibration motor on the wearer's skin, and what the wearer feels of it."""

from __future__ import annotations

from math import exp, inf, log
from typing import Final

# s, of a turning mass: 95 % after 180 ms (Precision Microdrives, step response of the 305-000).
RISE: Final = 0.06
LEAST: Final = 0.03  # s that a vibration must last to be felt as one (Remache-Vinueza, Sci. Reports 15:5057, 2025)


class FeltMotor:
    """Its vibration follows its duty with a lag; the wearer feels what is above a share of the full vibration.

    It turns from its `start` on; the vibration is taken as proportional to the rest of the duty. The threshold is an
    assumption: it depends on the motor, the place, and how it is fixed.

    Attributes:
        felt: how often the wearer has felt it begin.
    """

    def __init__(self, start: float, full: float, felt_above: float) -> None:
        """`start`, `full`: shares of the supply; `felt_above`: share of the full vibration."""
        self.felt = 0
        self._range, self._above = (start, full), felt_above
        self._aim = self._level = 0.0
        self._at = 0  # ns of world time
        self._since = inf  # ns, since when it is above the threshold; inf: it isn't
        self._noticed = False

    def drive(self, share: float, now: int) -> None:
        """It has this share of the supply from `now` (ns of world time) on."""
        self.vibration(now)
        start, full = self._range
        self._aim = min(max((share - start) / (full - start), 0.0), 1.0) if share > 0.0 else 0.0

    def vibration(self, now: int) -> float:
        """What it gives now (ns of world time), 0 to 1."""
        aim, before, dt, above = self._aim, self._level, (now - self._at) * 1e-9, self._above
        self._at, self._level = now, aim + (before - aim) * exp(-max(dt, 0.0) / RISE)
        if self._level > above:
            if self._since == inf:
                waited = RISE * log((aim - before) / (aim - above)) if before < above else 0.0
                self._since = now - 1e9 * (dt - waited)
            self._notice(now)
        else:
            if before > above:
                until = RISE * log((before - aim) / (above - aim)) if aim < above else dt
                self._notice(now - 1e9 * (dt - until))
            self._since, self._noticed = inf, False
        return self._level

    def _notice(self, until: float) -> None:
        """It was above the threshold until then (ns)."""
        if not self._noticed and until >= self._since + LEAST * 1e9:
            self._noticed = True
            self.felt += 1
