"""The requests to all servos, and their order: samples, and now and then the servos' state."""

from __future__ import annotations

from typing import Final

from srl.drivers.servo_bus.line import Request
from srl.drivers.servo_bus.units import Units

SLOW: Final = 100_000_000  # ns between requests for anything but samples


class Plan:
    """Chooses requests: "sample", "extra" (a sample with temperature and voltage), "check", "watchdog"."""

    def __init__(self, units: Units) -> None:
        self._units = units
        asked = {"sample": units.sample, "extra": units.extra, "check": units.check}
        self._rotation = ["check"]
        watchdog = units.tables[0].get("bus_watchdog")
        if watchdog is not None:
            asked["watchdog"] = (watchdog.address, watchdog.size)
            self._rotation = ["check", "watchdog", "check", "extra"]
        self._asked = {
            what: (units.wire.group_read(address, size, units.ids), address, size)
            for what, (address, size) in asked.items()
        }
        self._next_slow, self._turn = 0, -2  # the first request is "extra"

    def check_soon(self) -> None:
        """Makes the next request a check."""
        self._next_slow, self._turn = 0, -1

    def next(self, now: int, away: set[int]) -> Request | None:
        """Returns the next request, to all but `away` (ids); None if no servo is left."""
        if now < self._next_slow:
            return self.request("sample", away)
        self._next_slow = now + SLOW
        self._turn = (self._turn + 1) % len(self._rotation)
        return self.request(self._rotation[self._turn], away)

    def request(self, what: str, away: set[int]) -> Request | None:
        """Like `next`, for a given kind of request."""
        frame, address, size = self._asked[what]
        if not away:
            return Request(frame, self._units.ids, size, what)
        ids = tuple(id for id in self._units.ids if id not in away)
        return Request(self._units.wire.group_read(address, size, ids), ids, size, what) if ids else None
