"""The loop: read all -> check -> control -> guard -> write all -> append one row. No blocking I/O.

`Loop.run` is the whole cycle; what each step means is in `runtime.loop.device`, `runtime.loop.cycle`,
`runtime.loop.request_queue` and `runtime.ipc.ring`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from runtime.contracts.signals import Stop
from runtime.ipc.layout import CYCLE, LINK_ACTIVE, Cause, State
from runtime.ipc.requests import Answer, Ask
from runtime.ipc.ring import RingWriter
from runtime.loop.clock import Clock
from runtime.loop.cycle import Cycle
from runtime.loop.device import Device
from runtime.loop.request_queue import Inbox, Item
from runtime.profile.graph import Graph

_WORD = {name: i for i, name in enumerate(CYCLE)}
_TICK = slice(_WORD["cycle"], _WORD["wake"] + 1)  # cycle, now, dt, deadline, wake
_NOW = _WORD["now"]
_READ, _CONTROL, _GUARD, _WRITE, _LOG = (_WORD[n] for n in ("read", "control", "guard", "write", "log"))
_OVERRUNS, _REQUEST = _WORD["overruns"], slice(_WORD["request"], _WORD["request_result"] + 1)


class Loop:
    """One run of the cycle, from READY to ENDED."""

    def __init__(
        self, graph: Graph, devices: list[Device], clock: Clock, cycle: Cycle, inbox: Inbox, ring: RingWriter
    ) -> None:
        self.graph, self.devices, self.clock = graph, devices, clock
        self.cycle, self.inbox, self.ring = cycle, inbox, ring
        self.actuators = [d for d in devices if d.driver.commands]
        self.links = [graph.board.index[f"{d.driver.name}.link"] for d in self.actuators]
        self.after_write: Callable[[Device], None] = lambda device: None  # keeps the supervisor's stop frames true
        self.each_cycle: Callable[[State], None] = lambda state: None  # signs of life, the supervisor's own

    def run(self, cycles: int | None = None) -> None:
        """Runs until the state machine ends; after `cycles`, or when the simulated world's task is done, it asks
        itself to end."""
        ints, monotonic, count = self.graph.board.ints, time.monotonic_ns, 0
        world = self.graph.world
        self.clock.start()
        while self.cycle.machine.state is not State.ENDED:
            tick = self.clock.wait()
            ints[_TICK] = count, tick.now, tick.dt, tick.deadline, monotonic()
            ints[_OVERRUNS] += tick.missed
            for device in self.devices:
                device.read(tick.now)
            item = self.inbox.take(tick.now)
            over = (cycles is not None and count >= cycles) or (world is not None and world.finished)
            if item is None and over and not self.cycle.machine.exiting:
                item = self.inbox.own(Ask.EXIT, Cause.END)
            ints[_READ] = monotonic()

            self._check(item, tick.missed)
            self.cycle.control()
            ints[_CONTROL] = monotonic()
            self.cycle.guard()
            ints[_GUARD] = monotonic()

            for device, link in zip(self.actuators, self.links, strict=True):
                if ints[link] & LINK_ACTIVE:
                    device.write(tick.now)
                    self.after_write(device)
            self._let_go(tick.now)
            ints[_WRITE] = written = monotonic()

            self.ring.append(self.graph.board.words)
            self.ring.touch(written)
            if item is not None:
                self._answer(item)
            self.each_cycle(self.cycle.machine.state)
            ints[_LOG] = monotonic() - written
            count += 1

    def _check(self, item: Item | None, missed: int) -> None:
        """Faults and the request act on the state; the row says which request this cycle took."""
        ints = self.graph.board.ints
        kind = Ask.NONE if item is None or item.answer is not Answer.NONE else item.request.kind
        answer = self.cycle.check(missed, kind, item.request.target if item else 0)
        if item is None:
            ints[_REQUEST] = 0
            return
        if item.answer is Answer.NONE:
            item.answer = answer
        if answer is Answer.DONE and kind in (Ask.START, Ask.RESET):
            self.inbox.forget_setpoints()
        if answer is Answer.REFUSED_FAULT:
            # A person's explicit act; they ask again once the device is well.
            for device in self.devices:
                device.recover(int(ints[_NOW]))
        ints[_REQUEST] = item.request.id, item.request.kind, item.request.target, item.answer

    def _answer(self, item: Item) -> None:
        machine = self.cycle.machine
        self.inbox.reply(item, machine.state, machine.cause, self.culprit())

    def culprit(self) -> str:
        """The name of what caused the stop, or nothing."""
        return self.graph.layout.culprit(self.cycle.machine.cause, self.cycle.machine.culprit)

    def _let_go(self, now: int) -> None:
        """Once a stop has begun, tells the devices that stop by themselves (limp) to do so."""
        machine = self.cycle.machine
        if machine.state not in (State.STOPPING, State.STOPPED):
            return
        for device, link in zip(self.actuators, self.links, strict=True):
            if not self.graph.board.ints[link] & LINK_ACTIVE and not device.lost:
                for actuator in self.graph.actuators:
                    if (
                        self.graph.devices[actuator.device] is device.driver
                        and self.cycle.category(actuator) is Stop.LIMP
                    ):
                        device.stop(Stop.LIMP, now)
                        self.after_write(device)
