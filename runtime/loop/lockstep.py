"""The cycle of a wholly simulated profile, step by step in this process: no clock, no ring, no telemetry.

For tests and measurements: the decisions are the loop's own (`runtime.loop.cycle`), the time is the world's.
"""

from __future__ import annotations

from collections.abc import Callable

from runtime.ipc.requests import RequestKind
from runtime.ipc.words import CYCLE, State
from runtime.loop.cycle import Cycle, limits_of
from runtime.loop.device import Device
from runtime.profile.graph import Graph


class Lockstep:
    """See the module's text.

    Attributes:
        graph: the wired system; its row holds what the last step made.
        cycle: the decisions.
        devices: in the profile's order.
        period: ns from one step to the next.
        count: steps made.
    """

    def __init__(self, graph: Graph, report: Callable[[str], None] = lambda text: None) -> None:
        """Opens the devices.

        Args:
            graph: of a profile whose devices are all simulated.
            report: takes an event in words.
        Raises:
            DeviceError: a simulated device can't be opened.
        """
        assert graph.world is not None
        self.graph, self._world, self.count = graph, graph.world, 0
        self.period = round(1e9 / graph.profile.rate)
        self.devices = [
            Device(d, graph.row.devices[i], graph.actuators_of(i), report) for i, d in enumerate(graph.devices)
        ]
        for device in self.devices:
            device.driver.open()
        self.cycle = Cycle(graph, limits_of(graph), automatic=True, report=report)

    def sense(self) -> None:
        """The first half of a step: the world goes on by a period, and the devices are read."""
        self.count += 1
        now, ints = self.count * self.period, self.graph.row.ints
        ints[CYCLE.cycle], ints[CYCLE.now], ints[CYCLE.dt] = self.count, now, self.period
        self._world.advance(now)
        for device in self.devices:
            device.read(now)

    def act(self, request: RequestKind = RequestKind.NONE) -> State:
        """The second half: decisions, then the commands; the state after them."""
        self.cycle.check(0, request, 0)
        self.cycle.control()
        self.cycle.guard()
        for device in self.devices:
            if device.active:
                device.write(self.count * self.period)
        return self.cycle.machine.state

    def step(self, request: RequestKind = RequestKind.NONE) -> State:
        """One whole cycle; `request` concerns the state (start, stop, reset)."""
        self.sense()
        return self.act(request)
