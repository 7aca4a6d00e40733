"""A person's hand that closes around an object: it goes its way, and where it is stopped it squeezes gently."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.sim.wearer.fitting import Fitted
from srl.sim.wearer.motion import quintic

ALL: Final = tuple(range(20))


class ClosingPerson:
    """A wearer that goes from posture to posture, never farther ahead of the measured hand than its lead.

    The hand's joints are springs, so the lead is the squeeze: 0.12 rad at a knuckle are 0.36 N m. That a person's force
    follows what the object needs, and not how far the hand would have closed, is the reason for it (Johansson and
    Westling 1984).
    """

    duration = float("inf")
    fitted: Fitted | None = None  # it isn't a recording

    def __init__(self, part: HumanHandPart, posture: Array, lead: float) -> None:
        """Args:
        part: its hand.
        posture: (20,) rad, at the start.
        lead: rad.
        """
        self._part, self._lead = part, lead
        self._path, self._start, self._seconds = posture[None], 0.0, 1.0
        self._held = np.full(20, np.nan)
        part.worn_by(self)

    def go(self, path: Array, start: float, seconds: float) -> None:
        """Goes along postures (k, 20), rad, with minimum jerk, from a world time on, s."""
        self._path, self._start, self._seconds = path, start, seconds

    def hold(self, t: float, joints: Sequence[int] = ALL) -> None:
        """Keeps what is wished now, at a world time, s, with these joints: from here on they are springs about it."""
        self._held[list(joints)] = self.target(t)[list(joints)]

    def wish(self, t: float) -> Array:
        """(20,) rad, where the hand would be at a world time without the object."""
        s = quintic(min(max((t - self._start) / self._seconds, 0.0), 1.0)) * (len(self._path) - 1)
        i = min(int(s), len(self._path) - 2) if len(self._path) > 1 else 0
        after = self._path[min(i + 1, len(self._path) - 1)]
        found: Array = self._path[i] + (s - i) * (after - self._path[i])
        return found

    def target(self, t: float) -> Array:
        """As `sim.wearer.Wearer`, but it depends on where the hand is."""
        wish = self.wish(t)
        if t <= 0.0:
            return wish
        q = self._part.position()
        return np.where(np.isnan(self._held), np.clip(wish, q - self._lead, q + self._lead), self._held)
