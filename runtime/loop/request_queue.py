"""The loop's requests: `srl stop` and the supervisor send them through the socket, bus clients through the ring.

Setpoints and parameters take effect here. Requests that concern the state go to the cycle, one a cycle.
The datagrams of the socket are described in `runtime.ipc.control_socket`.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from runtime.ipc.requests import Answer, Request, RequestKind, RequestReader
from runtime.ipc.run_folder import RunFolder
from runtime.ipc.words import DEVICE, LINK_CONNECTED, Cause, State
from runtime.profile.graph import Graph

_KINDS = {
    "start": RequestKind.START,
    "stop": RequestKind.STOP,
    "reset": RequestKind.RESET,
    "exit": RequestKind.EXIT,
    "fault": RequestKind.FAULT,
}
_CAUSES = {"bus_loss": Cause.BUS_LOSS, "end": Cause.END}  # causes that a sender outside the loop may give
_DATAGRAMS = 8  # datagrams read in one cycle: a flood of them must not delay the loop
_WAITING = 64  # requests in the queue; there is always room for a stop
_ANSWERS = {
    Answer.REFUSED_STATE: "not possible in this state",
    Answer.REFUSED_FAULT: "what caused the stop is still there; a device that refuses to move was told to recover",
    Answer.REFUSED_VALUE: "the value isn't finite, in bounds and of the right size",
    Answer.EXPIRED: "the request came too late",
}


@dataclass(slots=True)
class PendingRequest:
    """A request in progress. `sender` is the address for the answer; None for a request from the ring."""

    request: Request
    sender: str | None = None
    answer: Answer = Answer.NONE


@dataclass
class RequestQueue:
    """Collects the requests to the loop; see the module's docstring."""

    run_folder: RunFolder
    graph: Graph
    waiting: deque[PendingRequest] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self._requests = RequestReader(self.run_folder.requests)
        self.run_folder.loop_socket.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        self._socket.bind(str(self.run_folder.loop_socket))
        os.chmod(self.run_folder.loop_socket, 0o660)
        meta, row = self.graph.layout.meta, self.graph.row
        self._parameters = [(row.views[p["name"]], p["lower"], p["upper"]) for p in meta["parameters"]]
        self._setpoints = []
        for entry in meta["setpoints"]:
            owner = self.graph.layout.devices.index(entry["name"].partition(".")[0])
            self._setpoints.append((row.views[entry["name"]], owner))
            row.devices[owner, DEVICE.stamp] = -1
            row.devices[owner, DEVICE.link] |= LINK_CONNECTED
        self._stamps = [-1] * len(self._setpoints)
        self.end_asked = False  # set by a signal handler, at any instant

    def take(self, now: int) -> PendingRequest | None:
        """Takes over new setpoints and returns the next request that needs an answer; usually None."""
        if self.end_asked:
            self.end_asked = False
            self._queue(self.own(RequestKind.EXIT, Cause.REQUEST))
        for _ in range(_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(512)
            except BlockingIOError:
                break
            if (pending := _parse(data, sender)) is not None:
                self._queue(pending)
        clock = 0
        for request in self._requests.take():
            clock = clock or time.monotonic_ns()
            if request.kind is RequestKind.SETPOINT:
                self._set(request, now, clock)
            else:
                late = request.expires < clock and request.kind is not RequestKind.STOP
                self._queue(PendingRequest(request, answer=Answer.EXPIRED if late else Answer.NONE))
        if not self.waiting:
            return None
        pending = self.waiting.popleft()
        if pending.request.kind is RequestKind.PARAMETER and pending.answer is Answer.NONE:
            pending.answer = self._change(pending.request)
        return pending

    def _queue(self, pending: PendingRequest) -> None:
        """Queues a request. A stop goes to the front, and waiting requests that would start motion are refused."""
        if pending.request.kind not in (RequestKind.STOP, RequestKind.EXIT, RequestKind.FAULT):
            if len(self.waiting) < _WAITING:
                self.waiting.append(pending)
            return
        while self.waiting and len(self.waiting) >= _WAITING:
            self.waiting.pop()
        for other in self.waiting:
            if other.request.kind in (RequestKind.START, RequestKind.RESET):
                other.answer = Answer.REFUSED_STATE
        self.waiting.appendleft(pending)

    def own(self, kind: RequestKind, cause: Cause) -> PendingRequest:
        """Returns a request that the loop itself makes."""
        return PendingRequest(Request(0, kind, int(cause), 0, np.empty(0)))

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
        view[()] = request.values[0]
        return Answer.DONE

    def forget_setpoints(self) -> None:
        """Clears the setpoints: a limb that starts again waits for its clients to send first."""
        self._stamps = [-1] * len(self._setpoints)
        for view, owner in self._setpoints:
            view[...] = np.nan
            self.graph.row.devices[owner, DEVICE.stamp] = -1

    def reply(self, pending: PendingRequest, state: State, cause: Cause, culprit: str) -> None:
        """Answers a request from the socket. Senders through the ring read the row instead."""
        if pending.sender is None:
            return
        done = pending.answer is Answer.DONE
        content = {"ok": done, "state": state.name.lower(), "cause": cause.name.lower(), "culprit": culprit}
        if not done:
            content["error"] = _ANSWERS.get(pending.answer, "refused")
        try:
            self._socket.sendto(json.dumps(content).encode(), pending.sender)
        except OSError:
            pass  # the sender has gone; nobody waits for the answer

    def close(self) -> None:
        """Closes and removes the socket."""
        self._socket.close()
        self.run_folder.loop_socket.unlink(missing_ok=True)
        self._requests.close()


def _parse(data: bytes, sender: str | None) -> PendingRequest | None:
    try:
        content = json.loads(data)
        kind = _KINDS[content["ask"]]
        target = int(_CAUSES[content["cause"]]) if "cause" in content else 0
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return PendingRequest(Request(0, kind, target, 0, np.empty(0)), sender or None)
