"""The loop: read all -> check -> control -> guard -> write all -> append one row. No blocking I/O.

`Loop.run` is the whole cycle. The steps are described in `runtime.loop.device`, `runtime.loop.cycle`,
`runtime.loop.request_queue` and `runtime.ipc.ring`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from runtime.contracts.signals import Stop
from runtime.ipc.requests import Answer, RequestKind
from runtime.ipc.ring import RingWriter
from runtime.ipc.words import CYCLE, Cause, State
from runtime.loop.clock import Clock
from runtime.loop.cycle import Cycle
from runtime.loop.device import Device
from runtime.loop.request_queue import PendingRequest, RequestQueue
from runtime.profile.graph import Graph

_TICK = slice(CYCLE.cycle, CYCLE.wake + 1)  # cycle, now, dt, deadline, wake
_REQUEST = slice(CYCLE.request, CYCLE.request_result + 1)
_READ, _CONTROL, _GUARD, _WRITE, _LOG = CYCLE.read, CYCLE.control, CYCLE.guard, CYCLE.write, CYCLE.log
_OVERRUNS, _NOW = CYCLE.overruns, CYCLE.now


class Loop:
    """Runs the cycle from READY to ENDED.

    Attributes:
        commanded: the devices that take commands, in their order.
    """

    def __init__(
        self, graph: Graph, devices: list[Device], clock: Clock, cycle: Cycle, requests: RequestQueue, ring: RingWriter
    ) -> None:
        self.graph, self.devices, self.clock = graph, devices, clock
        self.cycle, self.requests, self.ring = cycle, requests, ring
        self.commanded = [d for d in devices if d.actuators]
        self.after_write: Callable[[Device], None] = lambda device: None  # keeps the supervisor's stop frames current
        self.each_cycle: Callable[[State], None] = lambda state: None  # sign of life, events about state changes

    def run(self, cycles: int | None = None) -> None:
        """Runs until the state machine has ended.

        After `cycles`, or once the simulated world's task is done, the loop requests its own exit.
        """
        ints, monotonic, count = self.graph.row.ints, time.monotonic_ns, 0
        world = self.graph.world
        self.clock.start()
        while self.cycle.machine.state is not State.ENDED:
            tick = self.clock.wait()
            ints[_TICK] = count, tick.now, tick.dt, tick.deadline, monotonic()
            ints[_OVERRUNS] += tick.missed
            for device in self.devices:
                device.read(tick.now)
            pending = self.requests.take(tick.now)
            over = (cycles is not None and count >= cycles) or (world is not None and world.finished)
            if pending is None and over and not self.cycle.machine.exiting:
                pending = self.requests.own(RequestKind.EXIT, Cause.END)
            ints[_READ] = monotonic()

            self._check(pending, tick.missed)
            self.cycle.control()
            ints[_CONTROL] = monotonic()
            self.cycle.guard()
            ints[_GUARD] = monotonic()

            for device in self.commanded:
                if device.active:
                    device.write(tick.now)
                    self.after_write(device)
            self._release(tick.now)
            for device in self.commanded:
                device.publish(tick.now)
            ints[_WRITE] = written = monotonic()

            self.ring.append(self.graph.row.words)
            self.ring.touch(written)
            if pending is not None:
                self._answer(pending)
            self.each_cycle(self.cycle.machine.state)
            ints[_LOG] = monotonic() - written
            count += 1

    def _check(self, pending: PendingRequest | None, missed: int) -> None:
        """Applies faults and the request to the state. The row says which request this cycle took."""
        ints = self.graph.row.ints
        if pending is None:
            self.cycle.check(missed, RequestKind.NONE, 0)
            ints[_REQUEST] = 0
            return
        request = pending.request
        kind = request.kind if pending.answer is Answer.NONE else RequestKind.NONE
        answer = self.cycle.check(missed, kind, request.target)
        if pending.answer is Answer.NONE:
            pending.answer = answer
        if answer is Answer.DONE and kind in (RequestKind.START, RequestKind.RESET):
            self.requests.forget_setpoints()
        if self.cycle.machine.recover:
            for device in self.devices:
                device.recover(int(ints[_NOW]))
        ints[_REQUEST] = request.id, request.kind, request.target, pending.answer

    def _answer(self, pending: PendingRequest) -> None:
        machine = self.cycle.machine
        self.requests.reply(pending, machine.state, machine.cause, self.culprit())

    def culprit(self) -> str:
        """The name of the part that caused the stop, or an empty text."""
        return self.graph.layout.culprit(self.cycle.machine.cause, self.cycle.machine.culprit)

    def _release(self, now: int) -> None:
        """Once a stop has begun, tells the devices that stop by themselves (limp) to do so."""
        if self.cycle.machine.state not in (State.STOPPING, State.STOPPED):
            return
        for device in self.commanded:
            if device.active or device.lost:
                continue
            for actuator in device.actuators:
                if self.cycle.category(actuator) is Stop.LIMP:
                    device.stop(Stop.LIMP, now)
                    self.after_write(device)
