"""Which commands left for their devices: a guard whose command didn't begins anew at what was sent last.

A guard bounds each command against the one before. If a device took none, or changed it, the one before is what the
device has, and not what was applied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from srl.runtime.guard import CommandGuard
from srl.runtime.ipc.header import DEVICE, LINK_ACTIVE
from srl.runtime.profile.graph import Graph

LONGEST = 2.0  # s of the same, after which it is the device's fault
STALL = 0.25  # s of beginning anew at what was sent, after which it is reported


class CommandDelivery:
    """Follows what left, from the row's words alone: so a replay finds the same."""

    def __init__(self, graph: Graph, guards: Sequence[CommandGuard], report: Callable[[str], None]) -> None:
        """
        Args:
            graph: the wired system.
            guards: by actuator.
            report: takes the text of an event; called rarely.
        """
        self._actuators, self._guards, self._report = graph.actuators, guards, report
        self._links = graph.row.devices[:, DEVICE.link]
        self._commands = graph.row.devices[:, DEVICE.commands]
        self._counts = self._commands.tolist()  # commands sent to each device until the cycle before
        # Of a device with several commands the count doesn't tell which left: there, one that is new has.
        self._alone = [len(graph.actuators_of(a.device)) == 1 for a in graph.actuators]
        self._sent = [a.sent.tobytes() for a in graph.actuators]  # as it was in the cycle before
        self._stalls = [0.0 for a in graph.actuators]  # s for which its guard has begun anew in each cycle
        self._lacks = [0.0 for a in graph.actuators]  # s as above, falling at a quarter of the rate in other cycles

    def tell(self, dt: float) -> None:
        """Tells each active device's guard whether its command of the cycle before left. `dt`: since then, s."""
        counts = self._commands.tolist()
        for i, (actuator, guard) in enumerate(zip(self._actuators, self._guards, strict=True)):
            left = counts[actuator.device] != self._counts[actuator.device]
            if not self._alone[i]:
                sent = actuator.sent.tobytes()
                left, self._sent[i] = left and sent != self._sent[i], sent
            if self._links.item(actuator.device) & LINK_ACTIVE:
                guard.resynchronise(left, dt)
                self._tell_stall(i, guard.resynchronised, dt)
        self._counts = counts

    def stalled(self) -> int:
        """The device, by index, that has taken no commands, or limited or misreported them, for too long; -1: none."""
        for i, actuator in enumerate(self._actuators):
            if self._lacks[i] > LONGEST and self._links.item(actuator.device) & LINK_ACTIVE:
                return actuator.device
        return -1

    def _tell_stall(self, i: int, resynchronised: bool, dt: float) -> None:
        """Reports a device that has taken no commands, or limited them all, for a while; and its end."""
        self._lacks[i] = self._lacks[i] + dt if resynchronised else max(self._lacks[i] - dt / 4, 0.0)
        before = self._stalls[i]
        self._stalls[i] = before + dt if resynchronised else 0.0
        name = self._actuators[i].name
        if before <= STALL < self._stalls[i]:
            self._report(f"'{name}' isn't sent as applied: the limb waits where it was sent last")
        elif before > STALL and not resynchronised:
            self._report(f"'{name}' is sent as applied again")
