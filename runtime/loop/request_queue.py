"""Requests that reach the loop: `srl stop` and the supervisor by a Unix socket, clients by the mailbox.

Datagrams on the socket are JSON: {"ask": "stop"}; the answer goes back to the sender's own address.
Setpoints and parameters take effect here; what concerns the state goes on to the cycle, one a cycle.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from runtime.ipc.layout import CYCLE, DEVICE, LINK_CONNECTED, Cause, State
from runtime.ipc.requests import Answer, Ask, MailboxReader, Request
from runtime.ipc.run_folder import RunDir
from runtime.profile.graph import Graph

_ASKS = {"start": Ask.START, "stop": Ask.STOP, "reset": Ask.RESET, "exit": Ask.EXIT, "fault": Ask.FAULT}
_CAUSES = {"bus_loss": Cause.BUS_LOSS, "end": Cause.END}  # what may be told from outside
_DATAGRAMS = 8  # read in one cycle: a flood mustn't hold up the loop
_WAITING = 64  # requests kept; a stop always finds room
_ANSWERS = {
    Answer.REFUSED_STATE: "not possible in this state",
    Answer.REFUSED_FAULT: "what caused the stop is still there; a device that refuses to move was told to recover",
    Answer.REFUSED_VALUE: "the value isn't finite, in bounds and of the right size",
    Answer.EXPIRED: "the request came too late",
}


@dataclass(slots=True)
class Item:
    """A request on its way; `sender` is where to send the answer, None for the mailbox."""

    request: Request
    sender: str | None = None
    answer: Answer = Answer.NONE


@dataclass
class Inbox:
    """See the module's text."""

    rundir: RunDir
    graph: Graph
    waiting: deque[Item] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self._mail = MailboxReader(self.rundir.mail)
        self.rundir.loop_socket.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        self._socket.bind(str(self.rundir.loop_socket))
        os.chmod(self.rundir.loop_socket, 0o660)
        meta, board = self.graph.layout.meta, self.graph.board
        self._parameters = [(board.views[p["name"]], p["lower"], p["upper"]) for p in meta["parameters"]]
        self._setpoints = []
        for entry in meta["setpoints"]:
            owner = self.graph.layout.devices.index(entry["name"].partition(".")[0])
            self._setpoints.append((board.views[entry["name"]], len(CYCLE) + owner * len(DEVICE)))
        for _, at in self._setpoints:
            board.ints[at] = -1
            board.ints[at + 1] |= LINK_CONNECTED
        self._stamps = [-1] * len(self._setpoints)
        self.end_asked = False  # set by a signal handler, at any instant

    def take(self, now: int) -> Item | None:
        """Lets setpoints in and returns the next request that wants an answer; None mostly."""
        if self.end_asked:
            self.end_asked = False
            self._queue(self.own(Ask.EXIT, Cause.REQUEST))
        for _ in range(_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(512)
            except BlockingIOError:
                break
            if (item := _parse(data, sender)) is not None:
                self._queue(item)
        clock = 0
        for request in self._mail.take():
            clock = clock or time.monotonic_ns()
            if request.kind is Ask.SETPOINT:
                self._set(request, now, clock)
            else:
                late = request.expires < clock and request.kind is not Ask.STOP
                self._queue(Item(request, answer=Answer.EXPIRED if late else Answer.NONE))
        if not self.waiting:
            return None
        item = self.waiting.popleft()
        if item.request.kind is Ask.PARAMETER and item.answer is Answer.NONE:
            item.answer = self._change(item.request)
        return item

    def _queue(self, item: Item) -> None:
        """A stop overtakes what waits, and what would have led into motion is refused."""
        if item.request.kind not in (Ask.STOP, Ask.EXIT, Ask.FAULT):
            if len(self.waiting) < _WAITING:
                self.waiting.append(item)
            return
        while self.waiting and len(self.waiting) >= _WAITING:
            self.waiting.pop()
        for other in self.waiting:
            if other.request.kind in (Ask.START, Ask.RESET):
                other.answer = Answer.REFUSED_STATE
        self.waiting.appendleft(item)

    def own(self, kind: Ask, cause: Cause) -> Item:
        """A request of the loop's own."""
        return Item(Request(0, kind, int(cause), 0, np.empty(0)))

    def _set(self, request: Request, now: int, clock: int) -> None:
        if request.expires < clock or not 0 <= request.target < len(self._setpoints):
            return
        view, at = self._setpoints[request.target]
        if request.values.size == view.size and np.isfinite(request.values).all():
            view[...] = request.values.reshape(view.shape)
            self._stamps[request.target] = now
            # An owner is as old as the oldest of its setpoints that have come.
            same = [s for s, (_, other) in zip(self._stamps, self._setpoints, strict=True) if other == at and s >= 0]
            self.graph.board.ints[at] = min(same)
            self.graph.board.ints[at + 2] += 1
        else:
            self.graph.board.ints[at + 3] += 1

    def _change(self, request: Request) -> Answer:
        if not 0 <= request.target < len(self._parameters) or request.values.size != 1:
            return Answer.REFUSED_VALUE
        view, lower, upper = self._parameters[request.target]
        if not lower <= request.values[0] <= upper:  # false for NaN, too
            return Answer.REFUSED_VALUE
        view[()] = request.values[0]
        return Answer.DONE

    def forget_setpoints(self) -> None:
        """A limb that starts again waits for its clients to speak first."""
        self._stamps = [-1] * len(self._setpoints)
        for view, at in self._setpoints:
            view[...] = np.nan
            self.graph.board.ints[at] = -1

    def reply(self, item: Item, state: State, cause: Cause, culprit: str) -> None:
        """Answers a request that came by the socket; the mailbox's askers read the row."""
        if item.sender is None:
            return
        done = item.answer is Answer.DONE
        content = {"ok": done, "state": state.name.lower(), "cause": cause.name.lower(), "culprit": culprit}
        if not done:
            content["error"] = _ANSWERS.get(item.answer, "refused")
        try:
            self._socket.sendto(json.dumps(content).encode(), item.sender)
        except OSError:
            pass  # the asker has gone; nothing waits for it

    def close(self) -> None:
        """Takes the socket away."""
        self._socket.close()
        self.rundir.loop_socket.unlink(missing_ok=True)
        self._mail.close()


def _parse(data: bytes, sender: str | None) -> Item | None:
    try:
        content = json.loads(data)
        kind = _ASKS[content["ask"]]
        target = int(_CAUSES[content["cause"]]) if "cause" in content else 0
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return Item(Request(0, kind, target, 0, np.empty(0)), sender or None)


def ask(rundir: RunDir, what: str, cause: str | None = None, timeout: float = 2.0) -> dict[str, object] | None:
    """Asks a running loop by its socket.

    Args:
        rundir: the instance.
        what: "start", "stop", "reset", "exit" or "fault".
        cause: for "exit" and "fault": a `Cause`'s name.
        timeout: s.
    Returns:
        The loop's answer; None if it gave none in time.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as asker:
        asker.bind("")  # an abstract address of its own, to be answered at
        asker.settimeout(timeout)
        message = {"ask": what} | ({"cause": cause} if cause else {})
        try:
            asker.sendto(json.dumps(message).encode(), str(rundir.loop_socket))
            answer: dict[str, object] = json.loads(asker.recv(2048))
        except (OSError, ValueError):
            return None
        return answer
