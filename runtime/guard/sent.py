"""Compares what was sent with what was applied, element by element: where a guard must begin anew."""

from __future__ import annotations

from math import isfinite, nan

from srl.runtime.contracts.signals import Kind


def rounding(value: float) -> float:
    """By how much a value may differ that was computed by other code, as in a replay."""
    return 1e-9 * max(1.0, abs(value))


class SentTracker:
    """Follows one command; see `CommandGuard.resynchronise` and docs/guard.md, "What was sent".

    An element is *taken* in a cycle if what was sent of it is what was applied, within the command's resolution, in
    that cycle or in the one before (a driver may send it in its next `read`). It is *stalled* once it wasn't taken
    for longer than the command's period.

    Attributes:
        restart_at: by element, where to begin anew: the newest one sent since the reset, else the first command. Always
            within the range that the guard itself has applied since the element was last taken: what is reported can
            narrow what the guard allows, and never widen it.
        timeout: s for which an element need not be taken.
        stalled: an element is stalled.
        false: s for which what is reported as sent, of any element, can't have been sent, less those in which it can.
    """

    def __init__(self, kind: Kind, timeout: float, resolution: list[float]) -> None:
        """
        Args:
            kind: of the command.
            timeout: s for which an element need not be taken.
            resolution: by element, the difference of what was sent and applied that is normal.
        """
        self._kind, self.timeout, self._resolution = kind, timeout, resolution
        self._dt = 0.0  # of the last cycle, s
        self.restart([0.0] * len(resolution))

    def restart(self, applied: list[float]) -> None:
        """Begins with the first command after a reset."""
        self.restart_at = self._low = self._high = applied  # low, high: the range that was applied since one was taken
        self._previous = [nan] * len(applied)  # what was applied one cycle ago; NaN where the guard began anew
        self._unsent = [0.0] * len(applied)  # s since one was taken
        self.stalled, self.false = False, 0.0

    def compare(self, sent: list[float], applied: list[float], transmitted: bool, dt: float) -> list[int]:
        """Returns the elements that part from the guard: it must begin anew there, at their `restart_at`.

        Args:
            sent: what was sent; NaN before the first command.
            applied: what the guard applied in the cycle before.
            transmitted: a command was transmitted since the last call.
            dt: s since the cycle before.
        """
        dt_before, self._dt = self._dt, dt
        if sent == applied and dt <= self.timeout and (transmitted or not self.stalled):
            self.all_taken(applied, dt)
            return []
        restart_at, unsent, parted = list(self.restart_at), list(self._unsent), []
        low, high = list(map(min, self._low, applied)), list(map(max, self._high, applied))
        self.stalled, wrong = False, False
        for i, (s, a, before, r) in enumerate(zip(sent, applied, self._previous, self._resolution, strict=True)):
            near, late = abs(s - a) <= r, abs(s - before) <= r  # False for NaN
            other = transmitted and isfinite(s) and not (near or late)
            false = other and abs(s - self._given(i, s, low[i], high[i])) > r
            if false:
                # A command was transmitted, and this wasn't it: the report says nothing. The guard goes on from its own
                # state, as else a stop would begin anew with each report.
                wrong, unsent[i], low[i], high[i] = True, dt, a, a
                continue
            # A device that rounds may hold what is applied without being sent anything. But in a stall, being near
            # to what was sent shows nothing, as the guard has begun there: until a command leaves, it isn't taken.
            spare = r + rounding(a)
            taken = (abs(s - a) <= spare or abs(s - before) <= spare) and (transmitted or unsent[i] <= self.timeout)
            if taken:
                unsent[i] = dt if near else dt + dt_before
                low[i], high[i] = (a, a) if near else (min(a, before), max(a, before))
            else:
                unsent[i] += dt
            stalled, limited = unsent[i] > self.timeout, other
            if transmitted and isfinite(s):
                restart_at[i] = self._given(i, s, low[i], high[i])
                if limited:  # from there it goes on, so what was applied before can't be sent any more
                    low[i] = high[i] = restart_at[i]
            if limited or (stalled and (taken or not near)):
                parted.append(i)
            self.stalled |= stalled
        previous = list(applied)
        for i in parted:
            previous[i] = nan
        self.false = self.false + dt if wrong else max(self.false - dt, 0.0) if transmitted else self.false
        self.restart_at, self._low, self._high, self._previous, self._unsent = restart_at, low, high, previous, unsent
        return parted

    def all_taken(self, applied: list[float], dt: float) -> None:
        """After a cycle of dt seconds in which all was sent as applied."""
        self.restart_at = self._low = self._high = self._previous = applied
        self._unsent, self.stalled, self.false = [dt] * len(applied), False, 0.0

    def last(self, sent: list[float], applied: list[float]) -> list[float]:
        """What was sent last, for a start there, by element; NaN where nothing was."""
        return [
            self._given(i, s, min(a, low), max(a, high))
            for i, (s, a, low, high) in enumerate(zip(sent, applied, self._low, self._high, strict=True))
        ]

    def _given(self, i: int, sent: float, low: float, high: float) -> float:
        """What can have been sent of an element for which `low` to `high` was applied since one was taken.

        A driver that reports another unit or sign must not move the limb there, nor one that is off by no more than
        its resolution, again and again. A velocity or torque may also end.
        """
        if self._kind is not Kind.POSITION:
            low, high = min(low, 0.0), max(high, 0.0)
        spare = rounding(sent)
        return low if sent < low - spare else high if sent > high + spare else sent
