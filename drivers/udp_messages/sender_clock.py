"""The clock of a sender of datagrams, mapped to the loop's; one that doesn't run as a clock does is found out."""

from __future__ import annotations

from typing import Final

from srl.drivers.devicetime import DeviceTime

_FARTHEST: Final = 1e10  # s; beyond it no clock is
_BACK: Final = 10.0  # s by which it may go back: more is a sender that began anew
_LOOK: Final = 4_000_000_000  # ns over which its rate is looked at
_OFF: Final = 0.1  # by which it may differ from 1: a network's jitter, no drift


class SenderClock:
    """Attributes:
    problem: why it is no clock in s; "" for nothing.
    """

    def __init__(self) -> None:
        self.problem = ""
        self._time = DeviceTime(1.0)
        self._newest: float | None = None  # s
        self._since: tuple[float, int] | None = None  # s of its own, ns of the loop's

    def stamp(self, time: float, now: int) -> int:
        """When a sample of `time` (s) that came by `now` was taken, ns. Raises ValueError: it is an old one."""
        if not abs(time) < _FARTHEST:
            raise ValueError(f"its time, {time:g}, is no clock's")
        before = self._newest
        if before is not None and before - _BACK < time <= before:
            raise ValueError("a sample came twice, or after a newer one")
        if before is None or time < before:
            self._time.restart()
            self._since = time, now
        self._newest = time
        assert self._since is not None
        began, since = self._since
        if now - since > _LOOK:
            found = (time - began) / (now - since) * 1e9
            if abs(found - 1.0) > _OFF:
                self.problem = f"its clock runs by {found:.3g} s in a second"
            self._since = time, now
        return self._time.stamp(round(time * 1e9), now)
