"""The following error of a command: how far the limb is from where it was commanded, and for how long.

The terms are CiA 402's (following error window 0x6065 and time-out 0x6066). A limb that is outside its window for
longer than the time-out doesn't follow: it is blocked, too weak for its load, unpowered, or measured wrong.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.runtime.contracts.compiled import bind_or_python
from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.contracts.terms import PLANAR_TWIST

WINDOW: Final = {"rad": 0.25, "m": 0.03, "1": 0.25}  # of a position, by its unit
PLANAR_WINDOW: Final = (0.25, 0.25, 0.5)  # m, m, rad
TIMEOUT: Final = 0.5  # s
MEMORY: Final = 10.0  # s in which the following error of a velocity is forgotten
BACK: Final = 0.25  # of the time within the window, by which the time beyond it is forgotten
SLIPS: Final = 2.0  # s, of a base, whose wheels slip


def usual_window(command: Command) -> Array:
    """(size,): how far a joint that follows may be from its command, by the unit of its position."""
    usual = WINDOW.get(command.unit.removesuffix("/s"), WINDOW["rad"])
    if command.unit in ("N", "m", "m/s"):
        usual = WINDOW["m"]
    slides = command.slides or ()
    return np.array([WINDOW["m"] if name in slides else usual for name in command.names] or [usual] * command.size)


def window_of(command: Command, speed: Array, given: Array | None = None) -> Array:
    """(size,): the window in force: what is given, else the command's own, else the usual one; `speed` is its limit."""
    usual = PLANAR_WINDOW if command.labels == PLANAR_TWIST else usual_window(command)
    own = command.window if given is None else given
    window = np.array(np.broadcast_to(usual if own is None else own, command.size), np.float64)
    if command.kind is not Kind.POSITION:  # on its way to the new velocity the limb is late
        window += command.lag * np.where(np.isfinite(speed), speed, 0.0)
    return window


class FollowingError:
    """Follows one command with feedback.

    A position is compared with the range from its command to what follows that with the lag as time constant (a first
    order lag). Of a velocity, the way that was measured is compared with the way that was commanded. What isn't
    measured for some cycles is made up for later. A torque says nothing of where the limb should be: it has none.

    The time beyond the window is added up, and goes back at a quarter of its speed within it: so a limb that swings
    through its window is found. A cycle in which it isn't measured counts for a quarter. One counts as a quarter of the
    time-out at most: no single one is enough.

    Attributes:
        window: (size,), in the unit of the position: the largest error that is normal.
        timeout: s that an error may last.
        exceeded: it has lasted longer than that.
    """

    def __init__(
        self, command: Command, measured: Array, applied: Array, speed: Array,
        window: Array | None = None, timeout: float = TIMEOUT,
    ) -> None:  # fmt: skip
        """
        Args:
            command: the command; its `lag` and `window` say what is normal.
            measured: position of the same joints, of the command's shape.
            applied: the guarded command.
            speed: (size,), the greatest speed that is commanded.
            window: in the place of the command's own. To that of a velocity comes the lag's way at the greatest speed.
            timeout: s.
        """
        self._measured, self._applied, self._size = measured, applied, command.size
        self._position = command.kind is Kind.POSITION
        self._planar = command.labels == PLANAR_TWIST
        self.window = window_of(command, speed, window)
        self.timeout = timeout
        self._state, self._before = np.zeros(self._size), np.zeros(self._size)
        self._span = np.array([max(command.lag, 1e-3) if self._position else SLIPS if self._planar else MEMORY])
        self._for = 0.0
        self.exceeded = False
        if self._position:
            self._step = bind_or_python("following-position", measured, applied, self.window, self._span, self._state)
        else:
            self._step = bind_or_python(
                "following-velocity", measured, applied, self.window, self._span, self._state, self._before
            )

    def restart(self) -> None:
        """The limb begins to be commanded, from where it is."""
        self._state[:] = self._applied.ravel() if self._position else 0.0
        self._before[:] = np.nan_to_num(self._measured.ravel(), posinf=0.0, neginf=0.0)
        self._for, self.exceeded = 0.0, False

    def step(self, dt: float, stale: bool = False) -> bool:
        """After a cycle of dt seconds; the new measurement is there. Returns `exceeded`.

        `stale`: what is measured is old, so nothing is judged, and the way that is commanded now is measured later.
        """
        most = self.timeout * BACK
        if dt > most or (found := self._step(dt, self._planar)) < 0:
            found = self._compute(dt, dt > most)
        if stale:
            self._for = 0.0
        elif not found:
            self._for = max(self._for - dt * BACK, 0.0)
        else:
            known = bool(np.isfinite(self._measured).all())
            self._for += min(dt, most) * (1.0 if known else BACK)
        self.exceeded = bool(found) and self._for > self.timeout
        return self.exceeded

    def errors(self) -> Array:
        """(size,): the present following error, measured less commanded, beyond what the lag explains."""
        if not self._position:
            return -self._state
        q, a = self._measured.ravel(), self._applied.ravel()
        nearest: Array = np.clip(q, np.minimum(a, self._state), np.maximum(a, self._state))
        return q - nearest

    def fits(self) -> bool:
        """Whether the limb is now within its window."""
        return bool((np.abs(self.errors()) <= self.window).all())

    def _compute(self, dt: float, paused: bool) -> bool:
        """What C does, in Python. `paused`: the loop was, and whether the device went on or stopped isn't known."""
        q, a = self._measured.ravel(), self._applied.ravel()
        share = min(1.0, dt / self._span[0])
        if self._position:
            self._state += (a - self._state) * share
            return not self.fits()
        known = np.isfinite(q)
        way = np.where(known, q - self._before, 0.0)
        if self._planar:
            known[:] = known.all()  # the way of one is that of the others, turned
            c, s = np.cos(q[2] - way[2] / 2), np.sin(q[2] - way[2] / 2)
            way[:2] = c * way[0] + s * way[1], c * way[1] - s * way[0]
            way[~known] = 0.0
        self._before[known] = q[known]
        asked = np.where(np.isfinite(a), a, 0.0) * dt
        if paused:
            asked = np.clip(way, np.minimum(asked, 0.0), np.maximum(asked, 0.0))
        self._state *= 1.0 - share
        self._state += asked - way
        return not (known.all() and np.isfinite(a).all() and self.fits())
