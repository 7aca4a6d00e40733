"""The loop's requests: `srl stop` and the supervisor send them through sockets, bus clients through the ring.

Setpoints and parameters take effect here. Requests that concern the state go to the cycle, one a cycle, with their
origin: it follows from the way they came and from what the kernel says of the sender, never from what they claim.
A stop comes before everything else, is never limited and never expires. Starts and resets are limited in rate and
expire, and one that was sent before a stop is refused after it.
"""

from __future__ import annotations

import os
import select
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from srl.runtime.ipc import answers
from srl.runtime.ipc.control_socket import LIFETIME
from srl.runtime.ipc.header import CLIENTS, DEVICE, LINK_CONNECTED, Cause, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, Request, RequestKind, RequestReader, permitted
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.control_end import ControlEnd, Datagram
from srl.runtime.loop.monitors import TokenBucket
from srl.runtime.profile.graph import Graph

_MOVES = {"start": RequestKind.START, "reset": RequestKind.RESET}
_CAUSES = {"bus_loss": Cause.BUS_LOSS, "end": Cause.END}  # causes that the supervisor may give
_DATAGRAMS = 4  # datagrams read in one cycle of each socket: a flood of them must not delay the loop
_WAITING = 64  # requests of one origin in the queue, and senders that wait for the same stop


@dataclass(slots=True)
class PendingRequest:
    """A request in progress.

    Attributes:
        request: the request.
        answer: its answer; NONE until it has one.
        end: the socket through which it came; None for a request that came another way.
        senders: addresses there for the answer.
        uid: the user who sent it; -1: unknown.
    """

    request: Request
    answer: Answer = Answer.NONE
    end: ControlEnd | None = None
    senders: list[str | bytes] = field(default_factory=list)
    uid: int = -1


class RequestQueue:
    """Collects the requests to the loop; see the module's docstring.

    Attributes:
        end_asked: set by a signal handler, at any instant: the run shall end.
        refused: requests that were refused since the last cycle and take no cycle of their own.
        dropped: number of requests since the last cycle for which there was no room.
        changed: parameters' requests that were carried out since the last cycle, each with the value before.
        notes: texts of the service's processes since the last cycle, each for an event. They change nothing.
        supervisor: the process whose datagrams are the service's own.
    """

    def __init__(self, run_folder: RunFolder, graph: Graph, stops: ControlEnd) -> None:
        """`stops`: the socket for what stops, which was there before the devices were opened."""
        self.graph = graph
        self._requests = RequestReader(run_folder.requests)
        self._control, self._stop = ControlEnd(run_folder.loop_socket), stops
        self._arrivals = select.poll()
        for end in (self._control, self._stop):
            self._arrivals.register(end, select.POLLIN)
        meta, row = graph.layout.meta, graph.row
        self._parameters = [(row.views[p["name"]], p["lower"], p["upper"]) for p in meta["parameters"]]
        self._setpoints = []
        for entry in meta["setpoints"]:
            owner = graph.layout.devices.index(entry["name"].partition(".")[0])
            self._setpoints.append((row.views[entry["name"]], owner))
            row.devices[owner, DEVICE.stamp] = -1
            row.devices[owner, DEVICE.link] |= LINK_CONNECTED
        self._stamps = [-1] * len(self._setpoints)
        self._stops: deque[PendingRequest] = deque()
        self._waiting: dict[Origin, deque[PendingRequest]] = {Origin.LOCAL: deque(), Origin.BUS: deque()}
        self._limits = {Origin.LOCAL: TokenBucket(), Origin.BUS: TokenBucket()}
        self._stopped = 0  # CLOCK_MONOTONIC ns: when the newest stop came
        self.end_asked = False
        self._noted = TokenBucket()
        self.refused: list[PendingRequest] = []
        self.changed: list[tuple[Request, float]] = []
        self.notes: list[str] = []
        self.dropped = 0
        self.supervisor = os.getppid()
        self._user = os.getuid()

    def take(self, now: int, stops_only: bool = False) -> PendingRequest | None:
        """Takes over new setpoints and returns the next request that needs an answer; usually None.

        `stops_only`: this cycle has another request already, before which only a stop may come.
        """
        self.refused.clear()
        self.changed.clear()
        self.notes.clear()
        self.dropped = 0
        if self.end_asked:
            self.end_asked = False
            self._queue_stop(self.own(RequestKind.EXIT, Cause.REQUEST))
        # What moves is read before what stops: of two that came in one cycle, the stop counts.
        if requests := self._requests.take():
            clock = time.monotonic_ns()
            for request in requests:
                self._take_bus(request, now, clock)
        if self._arrivals.poll(0):  # a sixth of the time of two readings in vain
            self._take_datagrams(now)
        return self._next(stops_only)

    def _take_datagrams(self, now: int) -> None:
        for _ in range(_DATAGRAMS):
            if (datagram := self._control.take()) is None:
                break
            self._take_local(datagram, now)
        for _ in range(_DATAGRAMS):
            if (datagram := self._stop.take()) is None:
                break
            self._take_stop(datagram)

    def _next(self, stops_only: bool) -> PendingRequest | None:
        if self._stops:
            # Those of this machine come first: a crowd at the bus must not delay them.
            pending = next((p for p in self._stops if p.request.origin not in CLIENTS), self._stops[0])
            self._stops.remove(pending)
            return pending
        if stops_only:
            return None
        for waiting in self._waiting.values():
            if waiting:
                pending = waiting.popleft()
                if pending.request.kind is RequestKind.PARAMETER and pending.answer is Answer.NONE:
                    pending.answer = self._change(pending.request)
                return pending
        return None

    def _take_local(self, datagram: Datagram, now: int) -> None:
        """A datagram of the socket for what moves."""
        ask, expires = datagram.content.get("ask"), datagram.content.get("expires")
        kind = _MOVES.get(ask) if isinstance(ask, str) else None
        text = datagram.content.get("text") if ask == "note" else None
        if isinstance(text, str) and datagram.uid == self._user and self._noted.take(now):
            self.notes.append(text)
            return
        if kind is None:
            self.dropped += 1
            return
        pending = self._received(datagram, kind, 0, Origin.LOCAL, self._control)
        if not isinstance(expires, int) or not 0 <= expires - time.monotonic_ns() <= LIFETIME:
            pending.answer = Answer.EXPIRED
        elif expires - LIFETIME < self._stopped:
            pending.answer = Answer.OVERTAKEN
        elif not self._limits[Origin.LOCAL].take(now):
            pending.answer = Answer.REFUSED_RATE
        if pending.answer is Answer.NONE:
            self._waiting[Origin.LOCAL].append(pending)  # the limit keeps this queue short
        else:
            self.refused.append(pending)

    def _take_stop(self, datagram: Datagram) -> None:
        """A datagram of the socket for what stops: each is a stop at least, and none is a service's but its own.

        The supervisor ends a run and tells of faults. A plain stop is never its own: a person at its keys asks for it.
        """
        ask, cause = datagram.content.get("ask"), 0
        own = datagram.pid == self.supervisor and ask in ("exit", "fault")
        origin = Origin.SERVICE if own else Origin.LOCAL
        kind = RequestKind.EXIT if ask == "exit" else RequestKind.STOP
        if origin is Origin.SERVICE:
            kind = RequestKind.FAULT if ask == "fault" else kind
            cause = int(_CAUSES.get(str(datagram.content.get("cause")), 0))
        self._queue_stop(self._received(datagram, kind, cause, origin, self._stop))

    @staticmethod
    def _received(
        datagram: Datagram, kind: RequestKind, target: int, origin: Origin, end: ControlEnd
    ) -> PendingRequest:
        senders = [] if datagram.sender is None else [datagram.sender]
        return PendingRequest(Request(0, kind, target, 0, np.empty(0), origin), Answer.NONE, end, senders, datagram.uid)

    def _take_bus(self, request: Request, now: int, clock: int) -> None:
        """A request from the ring. The bus waits for its number in a row, so a refused one takes a cycle, too."""
        pending = PendingRequest(request)
        allowed = permitted(request.origin, request.kind)
        if request.kind is RequestKind.SETPOINT:
            if allowed:
                self._set(request, now, clock)
        elif request.kind is RequestKind.STOP and allowed:
            self._queue_stop(pending)
        elif len(self._waiting[Origin.BUS]) >= _WAITING:
            self.dropped += 1
        else:
            if not allowed:
                pending.answer = Answer.REFUSED_ROLE
            elif request.expires < clock:
                pending.answer = Answer.EXPIRED
            elif request.kind is not RequestKind.PARAMETER and not self._limits[Origin.BUS].take(now):
                pending.answer = Answer.REFUSED_RATE
            self._waiting[Origin.BUS].append(pending)

    def _queue_stop(self, pending: PendingRequest) -> None:
        """Queues a stop and refuses what waits and would move. A stop as one that waits already joins that one."""
        self.overtake()
        request, same = pending.request, 0
        for other in self._stops:
            if (other.request.kind, other.request.target, other.request.origin) == (
                request.kind,
                request.target,
                request.origin,
            ):
                if request.id == 0:
                    other.senders += pending.senders[: _WAITING - len(other.senders)]
                    return
                same += 1
        if same < _WAITING:
            self._stops.append(pending)

    def overtake(self) -> None:
        """A stop, or a fault, comes now: what waits and would move, and what was sent before, is refused."""
        self._stopped = time.monotonic_ns()
        for waiting in self._waiting.values():
            for other in waiting:
                if other.request.kind in _MOVES.values() and other.answer is Answer.NONE:
                    other.answer = Answer.OVERTAKEN

    def own(self, kind: RequestKind, cause: Cause) -> PendingRequest:
        """Returns a request that the loop itself makes."""
        return PendingRequest(Request(0, kind, int(cause), 0, np.empty(0), Origin.SERVICE))

    def _set(self, request: Request, now: int, clock: int) -> None:
        if request.expires < clock or not 0 <= request.target < len(self._setpoints):
            return
        view, owner = self._setpoints[request.target]
        words = self.graph.row.devices[owner]
        if request.values.size == view.size and np.isfinite(request.values).all():
            view[...] = request.values.reshape(view.shape)
            self._stamps[request.target] = now
            # An owner's stamp is the oldest stamp of its setpoints that have arrived.
            same = [s for s, (_, other) in zip(self._stamps, self._setpoints, strict=True) if other == owner and s >= 0]
            words[DEVICE.stamp] = min(same)
            words[DEVICE.frames] += 1
        else:
            words[DEVICE.errors] += 1

    def _change(self, request: Request) -> Answer:
        if not 0 <= request.target < len(self._parameters) or request.values.size != 1:
            return Answer.REFUSED_VALUE
        view, lower, upper = self._parameters[request.target]
        if not lower <= request.values[0] <= upper:  # the comparison is false for NaN, too
            return Answer.REFUSED_VALUE
        self.changed.append((request, float(view[()])))
        view[()] = request.values[0]
        return Answer.DONE

    def forget_setpoints(self) -> None:
        """Clears the setpoints: a limb that starts again waits for its clients to send first."""
        self._stamps = [-1] * len(self._setpoints)
        for view, owner in self._setpoints:
            view[...] = np.nan
            self.graph.row.devices[owner, DEVICE.stamp] = -1

    def reply(self, pending: PendingRequest, state: State, cause: Cause, fault_source: str, latched: Latch) -> None:
        """Answers a request from a socket. Senders through the ring read the row instead."""
        if pending.end is None or not pending.senders:
            return
        content = answers.content(pending.answer, state, cause, fault_source, latched)
        for sender in pending.senders:
            pending.end.answer(sender, content)

    def close(self) -> None:
        """Closes and removes the sockets."""
        self._control.close()
        self._stop.close()
        self._requests.close()
