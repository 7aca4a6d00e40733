"""The loop: read all -> check -> control -> guard -> write all -> append one row. No blocking I/O.

`Loop.run` is the whole cycle. The steps are described in `srl.runtime.loop.device`, `srl.runtime.loop.cycle`,
`srl.runtime.loop.request_queue` and `srl.runtime.ipc.ring`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.header import CYCLE, Cause, Origin, State
from srl.runtime.ipc.requests import STATE_REQUESTS, Answer, RequestKind
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.loop.clock import Clock
from srl.runtime.loop.cycle import Cycle, by_itself
from srl.runtime.loop.device import Device
from srl.runtime.loop.monitors import ParameterChanges, Refusals, described, refusal
from srl.runtime.loop.request_queue import PendingRequest, RequestQueue
from srl.runtime.profile.graph import Graph

_TICK = slice(CYCLE.cycle, CYCLE.wake + 1)  # cycle, now, dt, deadline, wake
_READ, _CONTROL, _GUARD, _WRITE, _LOG = CYCLE.read, CYCLE.control, CYCLE.guard, CYCLE.write, CYCLE.log
_OVERRUNS, _NOW, _REFUSED = CYCLE.overruns, CYCLE.now, CYCLE.refused
_ENDED = State.ENDED
_STOPS = (State.STOPPING, State.STOPPED)  # named once: looking a member up takes longer than comparing it
_KIND, _RESULT, _ORIGIN = CYCLE.request_kind, CYCLE.request_result, CYCLE.request_origin
_TARGET = CYCLE.request_target


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
        self.refusals = Refusals(cycle.report)
        self.remark = cycle.report  # takes the text of an event that is no warning
        self.changes = ParameterChanges(graph.layout.meta["parameters"])
        self._started = False  # whether a start or reset was granted in this cycle
        # Keeps the supervisor's stop frames current. Not for a device that this write lost: its frame was for a
        # connection that is gone, and its driver belongs to the thread that opens it again.
        self.after_write: Callable[[Device], None] = lambda device: None
        self.each_cycle: Callable[[State], None] = lambda state: None  # sign of life, events about state changes

    def run(self, cycles: int | None = None) -> None:
        """Runs until the state machine has ended.

        After `cycles`, or once the simulated world's task is done, the loop requests its own exit.
        """
        ints, monotonic, count = self.graph.row.ints, time.monotonic_ns, 0
        world = self.graph.world
        self.clock.start()
        while self.cycle.machine.state is not _ENDED:
            tick = self.clock.wait()
            ints[_TICK] = count, tick.now, tick.dt, tick.deadline, monotonic()
            ints[_OVERRUNS] += tick.missed
            for device in self.devices:
                device.read(tick.now)
            pending = self.requests.take(tick.now, stops_only=self.cycle.reset_inputs.pressed >= 0)
            over = (cycles is not None and count >= cycles) or (world is not None and world.finished)
            if pending is None and over and not self.cycle.machine.exiting:
                pending = self.requests.own(RequestKind.EXIT, Cause.END)
            ints[_READ] = monotonic()

            self._check(pending, tick.missed)
            self.cycle.control()
            ints[_CONTROL] = monotonic()
            self.cycle.guard()
            ints[_GUARD] = monotonic()

            self.write(tick.now)
            ints[_WRITE] = written = monotonic()

            if world is not None:
                self.graph.row.round_truth()
            self.ring.append(self.graph.row.words)
            self.ring.touch(written)
            for each in self.requests.refused if pending is None else (pending, *self.requests.refused):
                self._answer(each)
            for text in self.requests.notes:
                self.cycle.report(text)
            self.refusals.turn(tick.now)
            for request, before in self.requests.changed:
                self.changes.add(request, before)
            for text in self.changes.due(tick.now):
                self.remark(text)
            if self._started:  # after the row, which holds what this cycle saw
                self._started = False
                self.requests.forget_setpoints()
            self.each_cycle(self.cycle.machine.state)
            ints[_LOG] = monotonic() - written
            count += 1

    def write(self, now: int) -> None:
        """Sends the commands, tells devices to stop by themselves, and takes what has left into the row."""
        for device in self.commanded:
            if device.active:
                device.write(now)
                if not device.lost:
                    self.after_write(device)
        for device in release(self.cycle, self.commanded, now):
            self.after_write(device)
        for device in self.commanded:
            device.publish(now)

    def _check(self, pending: PendingRequest | None, missed: int) -> None:
        """Applies faults and the request to the state. The row says which request this cycle took."""
        ints, machine = self.graph.row.ints, self.cycle.machine
        if others := len(self.requests.refused) + self.requests.dropped:
            self._count(others)
        before = machine.state, machine.latches
        if pending is None:
            self.cycle.check(missed)
        else:
            pending.answer = self.cycle.check(missed, pending.request, pending.answer)
        if self.cycle.fault_onset:
            self.requests.overtake()
        if ints.item(_ORIGIN):
            self._note(-1 if pending is None else pending.uid, (machine.state, machine.latches) != before)
        if machine.recover:
            for device in self.devices:
                device.recover(int(ints[_NOW]))

    def _count(self, others: int) -> None:
        """Counts refused requests that no row tells of."""
        self.graph.row.ints[_REFUSED] += others
        what = "what is no request, or one too many" if self.requests.dropped else ""
        for each in self.requests.refused:
            what = refusal(each.request.kind, each.request.origin, each.uid, each.answer)
        self.refusals.add(others, what)

    def _note(self, uid: int, changed: bool) -> None:
        """Follows up the request that the row tells of."""
        ints = self.graph.row.ints
        kind, origin, answer = RequestKind(ints.item(_KIND)), Origin(ints.item(_ORIGIN)), Answer(ints.item(_RESULT))
        if answer is not Answer.DONE:
            self.refusals.add(1, refusal(kind, origin, uid, answer))
        elif kind in STATE_REQUESTS and changed:
            own_end = origin is Origin.SERVICE and ints.item(_TARGET) == Cause.END
            if own_end:
                self.remark("the run's time or its task is over")
            else:
                self.cycle.report(described(kind, origin, uid))
        self._started = answer is Answer.DONE and kind in (RequestKind.START, RequestKind.RESET)

    def _answer(self, pending: PendingRequest) -> None:
        machine = self.cycle.machine
        self.requests.reply(pending, machine.state, machine.cause, self.fault_source(), machine.latches)

    def fault_source(self) -> str:
        """The name of the part that caused the stop, or an empty text."""
        return self.graph.layout.fault_source(self.cycle.machine.cause, self.cycle.machine.fault_source)


def release(cycle: Cycle, devices: Iterable[Device], now: int) -> list[Device]:
    """In each cycle of a stop, tells the devices that stop by themselves to do so. Returns those still there."""
    if cycle.machine.state not in _STOPS:
        return []
    stopped = []
    for device in devices:
        if device.active or device.lost:
            continue
        for actuator in device.actuators:
            category = cycle.category(actuator)
            if category in (Stop.LIMP, Stop.OFF) or by_itself(actuator, category):
                device.stop(category, now)
                if not device.lost:
                    stopped.append(device)
    return stopped
