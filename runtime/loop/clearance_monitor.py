"""Gives a guard's clearance what it looks at, with its age, and tells people why the limb is held."""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from srl.runtime.contracts.clearance import NEVER
from srl.runtime.guard.verified import VerifiedStop
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_CONNECTED, LINK_STALE
from srl.runtime.profile.graph import Actuator, Graph

HELD = 0.25  # s of being held, and of not being held, after which it is reported


class ClearanceMonitor:
    """One command's; see the module's docstring. Reads and writes only the row."""

    def __init__(self, graph: Graph, actuator: Actuator, report: Callable[[str], None]) -> None:
        self._row, self._actuator, self._report = graph.row, actuator, report
        self._stamps, self._links = graph.row.devices[:, DEVICE.stamp], graph.row.devices[:, DEVICE.link]
        self._held = self._free = 0.0  # s
        self._reported = False

    def look(self, verified: VerifiedStop, ran: bool) -> None:
        """Begins a cycle. ran: all laws have computed their outputs in it."""
        cleared = self._actuator.cleared
        assert cleared is not None
        for index, array in cleared.copies:
            self._row.floats.take(index, 0, array, "clip")
        now = self._row.ints.item(CYCLE.now)
        stamps = {}
        for name, devices in cleared.devices.items():
            usable = ran or name not in cleared.computed
            stamps[name] = min(map(self._stamp, devices)) if usable else NEVER
        taken = self._stamps.item(self._actuator.device)
        verified.begin(now, stamps, max(now - taken, 0) * 1e-9 if taken >= 0 else 0.0)

    def tell(self, verified: VerifiedStop, dt: float) -> None:
        """Ends a cycle: writes the margin, and reports when the limb is held and when no longer."""
        actuator = self._actuator
        assert actuator.margin is not None
        actuator.margin[0] = verified.margin
        self._held, self._free = (self._held + dt, 0.0) if verified.held else (0.0, self._free + dt)
        if self._held > HELD and not self._reported:
            self._reported = True
            self._report(f"'{actuator.name}' is held: {verified.why}")
        elif self._free > HELD and self._reported:
            self._reported = False
            self._report(f"'{actuator.name}' is held no longer")

    def rest(self) -> None:
        """In a cycle in which nothing is commanded: the limb may go anywhere."""
        if self._actuator.cleared is not None:
            self._actuator.cleared.clearance.extent = None
        if self._actuator.margin is not None:
            self._actuator.margin[0] = nan

    def _stamp(self, device: int) -> int:
        """When a device's newest sample was taken; NEVER for one that is lost or stale."""
        link = self._links.item(device)
        return self._stamps.item(device) if link & LINK_CONNECTED and not link & LINK_STALE else NEVER
