"""Clients' requests: they are checked here, sent to the loop through the request ring, and answered from the rows.

Every query gets one JSON object: {"ok": true, "state": ...} or {"ok": false, "state": ..., "error": "place:
problem. Remedy."}. A stop goes to the loop at once. Of the other requests, only a few are in the ring at a time,
so that a stop never waits behind them. The newest value of a setpoint is sent at most once a cycle.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from srl.runtime.bus import refusals
from srl.runtime.bus.arrivals import Arrivals, sender_of
from srl.runtime.bus.status import Counts
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CLIENTS, CYCLE, DEVICE, Origin, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import Answer, RequestKind, RequestWriter, permitted
from srl.runtime.messages import messages
from srl.runtime.profile.keys import COMMANDS, ROLES, Keys

TIMEOUT = 1_000_000_000  # ns after which a request that the loop has not taken is given up
UNDERWAY = 4  # requests in the ring at a time, stops not counted: the loop takes one a cycle
WAITING = 64
_ORIGINS = {None: Origin.BUS} | {role: Origin[role.upper()] for role in ROLES}  # by the role of the keys
_REPORT_EVERY = 1_000_000_000  # ns between requests beyond a role that are passed on, so that the rows hold them
_KINDS = {"start": RequestKind.START, "stop": RequestKind.STOP, "reset": RequestKind.RESET}
_REQUEST, _KIND, _RESULT, _STATE = CYCLE.request, CYCLE.request_kind, CYCLE.request_result, CYCLE.state
_ORIGIN = CYCLE.request_origin


@dataclass(slots=True)
class Asked:
    """A setpoint whose sender waits until the loop has it. `frames`: its owner's count when it was sent; -1 before."""

    query: zenoh.Query
    key: str
    index: int
    values: Array
    until: int  # CLOCK_MONOTONIC ns
    frames: int = -1


@dataclass(slots=True)
class Pending:
    """A query in progress."""

    query: zenoh.Query
    place: str
    kind: RequestKind
    target: int
    values: Array | None
    until: int  # CLOCK_MONOTONIC ns
    origin: Origin
    sender: str = ""  # of a parameter: what it calls itself


class Requests:
    """Handles clients' requests; see the module's docstring. Only one thread may call its methods.

    Attributes:
        busy: True while a request or setpoint waits for the loop.
    """

    def __init__(self, layout: Layout, keys: Keys, ring: RequestWriter, counts: Counts, arrivals: Arrivals) -> None:
        self._layout, self._keys, self._ring, self._counts = layout, keys, ring, counts
        self._arrivals = arrivals
        self._parameters: list[dict[str, Any]] = layout.meta.get("parameters", [])
        self._setpoints: list[dict[str, Any]] = layout.meta.get("setpoints", [])
        self._underway: dict[int, Pending] = {}
        self._waiting: deque[Pending] = deque()
        self._newest: dict[int, tuple[int, Array]] = {}  # setpoints to send next, by index: expiry, values
        self._asked: list[Asked] = []
        self._keys_of = [keys, *(Keys(keys.instance, role) for role in ROLES)]
        self._by_key = {k.setpoint(s["name"]): i for k in self._keys_of for i, s in enumerate(self._setpoints)}
        self._reported: dict[Origin, int] = {}  # CLOCK_MONOTONIC ns
        owners = [s["name"].partition(".")[0] for s in self._setpoints]
        self._frames = [layout.device(layout.devices.index(owner)).start + DEVICE.frames for owner in owners]
        self._row: NDArray[np.int64] | None = None
        self._cycle = -1
        self._warned = 0.0
        self.silent = False

    def handlers(self) -> dict[str, Callable[[zenoh.Query], None]]:
        """The functions that answer queries, by key expression."""
        found: dict[str, Callable[[zenoh.Query], None]] = {}
        for keys in self._keys_of:
            for name in COMMANDS:
                found[keys.command(name)] = partial(self._command, keys, name)
            for i, parameter in enumerate(self._parameters):
                found[keys.parameter(parameter["name"])] = partial(self._parameter, keys, i)
            for i, setpoint in enumerate(self._setpoints):
                found[keys.setpoint(setpoint["name"])] = partial(self._asked_setpoint, keys, i)
            if keys.role is not None:
                found[keys.whoami] = partial(self._whoami, keys)
        return found

    def stops(self) -> frozenset[str]:
        """The keys of the command that never waits."""
        return frozenset(keys.command("stop") for keys in self._keys_of if not keys.reads_only)

    def only_reads(self, key: str) -> bool:
        """Whether a key is that of a role that commands nothing."""
        return key.startswith(f"{Keys(self._keys.instance, 'observer').asked}/")

    def subscribers(self) -> dict[str, Callable[[zenoh.Sample], None]]:
        """The functions that take samples, by key."""
        return {keys.setpoints: partial(self._put_setpoint, keys) for keys in self._keys_of if not keys.reads_only}

    def strangers(self) -> dict[str, Callable[[zenoh.Query], None]]:
        """The functions that answer queries for names that aren't there, by the expression of all keys of the kind.

        They must be given no other query: `known` tells.
        """
        found: dict[str, Callable[[zenoh.Query], None]] = {}
        for keys in self._keys_of:
            found |= {
                keys.commands: partial(self._unknown, keys, "command", COMMANDS),
                keys.parameters: partial(self._unknown, keys, "parameter", [p["name"] for p in self._parameters]),
                keys.setpoints: partial(self._unknown, keys, "setpoint", [s["name"] for s in self._setpoints]),
            }
        return found

    def known(self) -> Callable[[zenoh.Query], bool]:
        """A function, for any thread, that tells whether a query is for a name that is there, or for many names."""
        keys = frozenset(self.handlers())

        def tell(query: zenoh.Query) -> bool:
            key = str(query.key_expr)
            return key in keys or "*" in key

        return tell

    @property
    def busy(self) -> bool:
        """True while a request or setpoint waits for the loop."""
        return bool(self._underway or self._waiting or self._newest or self._asked)

    # Queries

    def _whoami(self, keys: Keys, query: zenoh.Query) -> None:
        self._reply(query, keys.whoami, {"role": keys.role})

    def _command(self, keys: Keys, name: str, query: zenoh.Query) -> None:
        key = keys.command(name)
        crowd = len(self._underway if name == "stop" else self._waiting)
        if not self._answerable(query, key, crowd):
            return
        if name != "stop" and self._arrivals.overtaken:
            self._refuse(query, key, RequestError(key, *refusals.OVERTAKEN))
        else:
            self._pass_on(
                Pending(query, key, _KINDS[name], 0, None, time.monotonic_ns() + TIMEOUT, _ORIGINS[keys.role])
            )

    def _parameter(self, keys: Keys, index: int, query: zenoh.Query) -> None:
        parameter = self._parameters[index]
        key = keys.parameter(parameter["name"])
        if query.payload is None or not query.payload.to_bytes():
            # Reading is harmless: a wildcard may read all parameters.
            value = None if self._row is None else self._value(self._row, index)
            self._reply(query, key, {"ok": True, "value": value} | parameter)
            return
        if not self._answerable(query, key, len(self._waiting)):
            return
        until, origin = time.monotonic_ns() + TIMEOUT, _ORIGINS[keys.role]
        if not permitted(origin, RequestKind.PARAMETER):  # what it sends isn't even looked at
            self._pass_on(Pending(query, key, RequestKind.PARAMETER, index, None, until, origin))
            return
        lower, upper, unit = parameter["lower"], parameter["upper"], parameter["unit"]
        field = self._layout.fields[parameter["name"]]
        try:
            values = messages.read_values(query.payload.to_bytes(), str(query.encoding), field, key)
            if not lower <= values[0] <= upper:
                raise RequestError(key, f"{values[0]:g} {unit} is out of bounds", f"Send {lower:g} to {upper:g} {unit}")
        except RequestError as error:
            self._refuse(query, key, error)
            return
        self._pass_on(Pending(query, key, RequestKind.PARAMETER, index, values, until, origin, sender_of(query)))

    def _value(self, row: NDArray[np.int64], index: int) -> float:
        return float(self._layout.value(row[np.newaxis], self._parameters[index]["name"])[0])

    def _asked_setpoint(self, keys: Keys, index: int, query: zenoh.Query) -> None:
        setpoint = self._setpoints[index]
        key = keys.setpoint(setpoint["name"])
        # Also where it only asks before it sends: its samples would be lost in silence.
        if str(query.key_expr) == key and not permitted(_ORIGINS[keys.role], RequestKind.SETPOINT):
            self._reject(error := refusals.beyond(key, _ORIGINS[keys.role]))
            self._refuse(query, key, error)
            return
        payload = b"" if query.payload is None else query.payload.to_bytes()
        if not payload:
            # Reading is harmless, as with parameters.
            self._reply(query, key, {"ok": True} | messages.describe(self._layout.fields[setpoint["name"]]) | setpoint)
            return
        if not self._answerable(query, key, len(self._asked)):
            return
        try:
            values = self._setpoint(payload, str(query.encoding), index, key)
        except RequestError as error:
            self._reject(error)
            self._refuse(query, key, error)
        else:
            self._asked.append(Asked(query, key, index, values, time.monotonic_ns() + TIMEOUT))

    def _put_setpoint(self, keys: Keys, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            if key not in self._by_key:
                raise self._no_such(keys, "setpoint", [s["name"] for s in self._setpoints], key)
            self._setpoint(sample.payload.to_bytes(), str(sample.encoding), self._by_key[key], key)
        except RequestError as error:
            self._reject(error)

    def _setpoint(self, payload: bytes, encoding: str, index: int, key: str) -> Array:
        field: Field = self._layout.fields[self._setpoints[index]["name"]]
        expires = time.monotonic_ns() + round(self._setpoints[index]["max_age"] * 1e9)
        values = messages.read_values(payload, encoding, field, key)
        self._newest[index] = expires, values
        for other in [a for a in self._asked if a.index == index and a.frames < 0]:
            self._asked.remove(other)
            self._refuse(other.query, key, RequestError(key, "a newer setpoint took its place", "Send one at a time"))
        return values

    def _unknown(self, keys: Keys, what: str, names: Sequence[str], query: zenoh.Query) -> None:
        key = str(query.key_expr)
        self._refuse(query, key, self._no_such(keys, what, names, key))

    def _no_such(self, keys: Keys, what: str, names: Sequence[str], key: str) -> RequestError:
        name = key.removeprefix(f"{keys.asked}/").partition("/")[2].replace("/", ".")
        return RequestError(key, f"there is no {what} '{name}'", nearest(name, names))

    def _reject(self, error: RequestError) -> None:
        self._counts.rejected += 1
        self._counts.last_rejection = str(error)
        if (now := time.monotonic()) - self._warned >= 1.0:
            self._warned = now
            print(
                f"bus: setpoint refused ({self._counts.rejected} so far): {error}",
                file=sys.stderr,
                flush=True,
            )

    def _answerable(self, query: zenoh.Query, key: str, crowd: int) -> bool:
        """Whether a query may be handled; refuses it if not.

        A query by wildcard is refused: reading `srl/**` must not move or stop anything. `crowd` is the number of
        requests before it: a full ring would lose the oldest.
        """
        problem = None
        if str(query.key_expr) != key:
            problem = "what changes something takes its exact key, not a wildcard", f"Ask {key} itself"
        elif self.silent:
            problem = (
                "the loop gives no sign of life",
                "Look at the service's log; actuators are stopped by the supervisor",
            )
        elif crowd >= WAITING:
            problem = "too many requests wait already", "Ask less often"
        if problem is not None:
            self._refuse(query, key, RequestError(key, *problem))
        return problem is None

    # The way to the loop and back

    def _pass_on(self, pending: Pending) -> None:
        """Sends a request on its way. Of those beyond a role the loop gets one a second, to refuse: a record."""
        if not permitted(pending.origin, pending.kind):
            now = time.monotonic_ns()
            if now - self._reported.get(pending.origin, 0) < _REPORT_EVERY:
                self._refuse(pending.query, pending.place, refusals.beyond(pending.place, pending.origin))
                return
            self._reported[pending.origin] = now
        self._ask(pending)

    def _ask(self, pending: Pending) -> None:
        if pending.kind is RequestKind.STOP and permitted(pending.origin, pending.kind):
            for other in [p for p in self._waiting if p.kind in (RequestKind.START, RequestKind.RESET)]:
                self._waiting.remove(other)  # it came before the stop and would move the limb after it
                self._refuse(other.query, other.place, RequestError(other.place, *refusals.OVERTAKEN))
            self._send(pending)
        else:
            self._waiting.append(pending)
            self._fill()

    def _send(self, pending: Pending) -> None:
        p = pending
        self._underway[self._ring.send(p.kind, p.until, p.target, p.values, p.origin, p.sender)] = p

    def _fill(self) -> None:
        while self._waiting and len(self._underway) < UNDERWAY:
            self._send(self._waiting.popleft())

    def turn(self, rows: NDArray[np.int64], row: NDArray[np.int64] | None, silent: bool) -> None:
        """Runs one turn: answers requests from the rows, gives up those too old, sends those that are due.

        Args:
            rows: the rows since the last turn (k, width).
            row: the newest row (width,); None before the first.
            silent: True if the loop gives no sign of life.
        """
        self._row, self.silent = row, silent
        for taken in rows[rows[:, _REQUEST] != 0]:
            self._answer(taken)
        now = time.monotonic_ns()
        problem = "the loop gives no sign of life" if silent else "the loop gave no answer within 1 s"
        for number in [n for n, p in self._underway.items() if silent or p.until < now]:
            self._give_up(self._underway.pop(number), problem)
        while self._waiting and (silent or self._waiting[0].until < now):
            self._give_up(self._waiting.popleft(), problem)
        self._fill()
        self._answer_setpoints(rows, now, problem)
        if silent:
            self._newest.clear()
        if self._newest and row is not None and row[0] != self._cycle:
            self._cycle = int(row[0])
            for index, (expires, values) in self._newest.items():
                self._ring.send(RequestKind.SETPOINT, expires, index, values)
            self._newest.clear()
            for asked in self._asked:
                if asked.frames < 0:
                    asked.frames = int(row[self._frames[asked.index]])

    def _answer_setpoints(self, rows: NDArray[np.int64], now: int, problem: str) -> None:
        """Answers the senders of setpoints that the loop has taken: its rows hold them."""
        for asked in list(self._asked):
            name = self._setpoints[asked.index]["name"]
            taken = rows[rows[:, self._frames[asked.index]] > asked.frames] if asked.frames >= 0 else rows[:0]
            if any(np.array_equal(values.ravel(), asked.values) for values in self._layout.value(taken, name)):
                self._reply(asked.query, asked.key, {"ok": True, "state": self._state()})
            elif self.silent or asked.until < now:
                self._refuse(asked.query, asked.key, RequestError(asked.key, problem, "Look at the status"))
            else:
                continue
            self._asked.remove(asked)

    def _answer(self, row: NDArray[np.int64]) -> None:
        pending = self._underway.pop(int(row[_REQUEST]), None)
        if pending is None or int(row[_KIND]) != pending.kind or int(row[_ORIGIN]) not in CLIENTS:
            return  # the request came from an earlier bus process
        answer, state = Answer(int(row[_RESULT])), State(int(row[_STATE])).name.lower()
        if answer is Answer.DONE:
            content: dict[str, Any] = {"ok": True, "state": state}
            if pending.kind is RequestKind.PARAMETER:
                content["value"] = self._value(row, pending.target)
            self._reply(pending.query, pending.place, content)
            return
        error = refusals.refused(answer, pending.kind, pending.place, pending.origin, row, self._layout, self._keys)
        self._refuse(pending.query, pending.place, error, state)

    def _give_up(self, pending: Pending, problem: str) -> None:
        error = RequestError(pending.place, problem, "Look at the status before asking again")
        self._refuse(pending.query, pending.place, error)

    def end(self) -> None:
        """Answers all requests that still wait."""
        for pending in [*self._underway.values(), *self._waiting]:
            self._give_up(pending, "the run has ended")
        for asked in self._asked:
            self._refuse(asked.query, asked.key, RequestError(asked.key, "the run has ended", "Look at the status"))
        self._underway.clear()
        self._waiting.clear()
        self._asked.clear()

    def _state(self) -> str:
        if self.silent:
            return "unknown"
        return "starting" if self._row is None else State(int(self._row[_STATE])).name.lower()

    def _refuse(self, query: zenoh.Query, key: str, error: RequestError, state: str = "") -> None:
        self._reply(query, key, {"ok": False, "state": state or self._state(), "error": str(error)})

    def _reply(self, query: zenoh.Query, key: str, content: dict[str, Any]) -> None:
        reply(query, key, content)
        query.drop()


def reply(query: zenoh.Query, key: str, content: Any, encoding: str = messages.JSON) -> None:
    """Answers with JSON, or with bytes as they are. Drop the query after its last answer, or its sender waits on."""
    with contextlib.suppress(zenoh.ZError):  # the sender has gone
        query.reply(key, content if isinstance(content, bytes) else json.dumps(content), encoding=encoding)
