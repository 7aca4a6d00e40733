"""Runs the cycle of a fully simulated profile step by step in this process: no clock, no ring, no telemetry.

For tests and measurements, and for files that are played as devices. The decisions are the loop's own
(`srl.runtime.loop.cycle`), the time is the world's, or counted where there is none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from srl.runtime.ipc.header import CYCLE, Origin, State
from srl.runtime.ipc.requests import Request, RequestKind
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.loop import release
from srl.runtime.profile.graph import Graph


class Lockstep:
    """Steps a simulated system; see the module's docstring.

    Attributes:
        graph: the wired system; its row holds the result of the last step.
        cycle: the decisions.
        devices: the devices, in the profile's order.
        period: ns from one step to the next.
        count: number of steps made.
    """

    def __init__(self, graph: Graph, report: Callable[[str], None] = lambda text: None) -> None:
        """Opens the devices.

        Args:
            graph: the wired system of a profile whose devices are all simulated, or played from files.
            report: takes the text of an event.
        Raises:
            DeviceError: a simulated device can't be opened.
        """
        self.graph, self._world, self.count = graph, graph.world, 0
        self.period = round(1e9 / graph.profile.rate)
        self.devices = [
            Device(d, graph.row.devices[i], graph.actuators_of(i), report) for i, d in enumerate(graph.devices)
        ]
        for device in self.devices:
            device.driver.open()
        self._commanded = [device for device in self.devices if device.actuators]
        limits = limits_of(graph)
        for device in self.devices:
            device.expect(limits)
        self.cycle = Cycle(graph, limits, automatic=True, report=report)

    def sense(self) -> None:
        """The first half of a step: advances the world by a period and reads the devices."""
        self.count += 1
        now, ints = self.count * self.period, self.graph.row.ints
        ints[CYCLE.cycle], ints[CYCLE.now], ints[CYCLE.dt] = self.count, now, self.period
        if self._world is not None:
            self._world.advance(now)
        for device in self.devices:
            device.read(now)

    def act(self, kind: RequestKind = RequestKind.NONE, origin: Origin = Origin.LOCAL) -> State:
        """The second half of a step: makes the decisions, sends the commands and returns the new state."""
        now = self.count * self.period
        self.cycle.check(0, Request(0, kind, 0, 0, np.empty(0), origin) if kind else None)
        if self.cycle.machine.recover:
            for device in self.devices:
                device.recover(now)
        self.cycle.control()
        self.cycle.guard()
        for device in self._commanded:
            if device.active:
                device.write(now)
        release(self.cycle, self._commanded, now)
        for device in self._commanded:
            device.publish(now)
        return self.cycle.machine.state

    def step(self, kind: RequestKind = RequestKind.NONE, origin: Origin = Origin.LOCAL) -> State:
        """Runs one whole cycle, with a request that concerns the state (start, stop, reset)."""
        self.sense()
        return self.act(kind, origin)
