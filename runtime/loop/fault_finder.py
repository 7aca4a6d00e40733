"""What is wrong in a cycle: a device that is lost, stale or refuses, a client that is silent, an emergency input."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from srl.runtime.ipc.header import (
    DEVICE,
    LINK_ACTIVE,
    LINK_CONNECTED,
    LINK_ERROR,
    LINK_FAULT,
    LINK_STALE,
    Cause,
)
from srl.runtime.loop.machine import Fault
from srl.runtime.loop.pose_monitor import PoseMonitor
from srl.runtime.profile.graph import Graph

_ILL = LINK_CONNECTED | LINK_ERROR | LINK_FAULT | LINK_STALE  # of a device that is well only the first is set


class FaultFinder:
    """Reads the devices' words of the row, and marks there which are stale."""

    def __init__(self, graph: Graph, lost: Callable[[int], None], watch: Callable[[bool], None]) -> None:
        """Takes what it looks at.

        Args:
            graph: the wired system.
            lost: is told of an active device, by index, that is away or at fault.
            watch: is told in each cycle without an emergency whether there is trouble in what a stop depends on.
        """
        self._graph, self._lost, self._watch = graph, lost, watch
        self._stamps, self._links = graph.row.devices[:, DEVICE.stamp], graph.row.devices[:, DEVICE.link]
        self._max_age = self._ages()
        self._poses = PoseMonitor(graph.monitored_poses)
        self._count = len(graph.devices)  # clients come after them
        owners = graph.layout.devices
        self._emergency = [
            (graph.element(e), e.when, owners.index(e.signal.partition(".")[0])) for e in graph.profile.emergency
        ]

    def find(self, now: int) -> Fault | None:
        """The fault of the cycle at `now` (ns): an emergency, or that of the first device that has one."""
        stamps, links = self._stamps.tolist(), self._links.tolist()  # plain integers: each costs a tenth of a numpy one
        fault: Fault | None = None
        trouble = False  # in what the stop depends on
        lost_poses = self._poses.lost(now)
        for i, max_age in enumerate(self._max_age):
            stamp, link = stamps[i], links[i]
            client = i >= self._count
            # A client that has not sent anything yet is not stale. A device without a sample is.
            stale = max_age > 0 and (abs(now - stamp) > max_age if stamp >= 0 else not client)
            stale |= i in lost_poses
            if not stale and link & _ILL == LINK_CONNECTED:
                continue  # the usual: nothing to find
            if stale != bool(link & LINK_STALE):
                link ^= LINK_STALE
                self._links[i] = link
            if link & LINK_ACTIVE and (not link & LINK_CONNECTED or link & LINK_FAULT):
                self._lost(i)
            if not client and self._graph.devices[i].commands:
                trouble |= stale or not link & LINK_CONNECTED or bool(link & (LINK_ERROR | LINK_FAULT))
            if fault is not None:
                continue
            if link & LINK_ERROR:
                fault = Fault(Cause.DRIVER_ERROR, i)
            elif stale or not link & LINK_CONNECTED:
                if self._graph.intent[i]:
                    fault = Fault(Cause.INTENT_LOSS, i)
                elif not client and self._graph.devices[i].commands:
                    fault = Fault(Cause.DEVICE_LOSS, i)
            elif link & LINK_FAULT:
                fault = Fault(Cause.DEVICE_FAULT, i)
        for i, (element, when, device) in enumerate(self._emergency):
            if element[0] == when or not isfinite(element[0]):
                return Fault(Cause.EMERGENCY, i)
            link = self._links.item(device)
            if not link & LINK_CONNECTED or link & LINK_STALE:
                trouble = True
                if fault is None or self.of_client(fault):  # a client's silence doesn't hinder a reset, this does
                    fault = Fault(Cause.DEVICE_LOSS, device)  # a switch that can't be read can't stop anything
        self._watch(trouble)
        return fault

    def of_client(self, fault: Fault | None) -> bool:
        """Whether the fault is a client's silence."""
        return fault is not None and fault.cause is Cause.INTENT_LOSS and fault.fault_source >= self._count

    def _ages(self) -> list[int]:
        """Each device's max_age in ns; 0 for a device that gives nothing that could be stale."""
        ages = [round(d.max_age * 1e9) for d in self._graph.devices]
        for owner in self._graph.layout.devices[len(ages) :]:
            entries = self._graph.profile.setpoints.items()
            ages.append(round(min(e.max_age for n, e in entries if n.startswith(f"{owner}.")) * 1e9))
        return ages
