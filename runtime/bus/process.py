"""The bus process: it follows the ring, publishes the rows, and passes clients' requests to the loop.

One thread does all the work; zenoh's own threads only put arriving items into a queue. The process may be killed
at any instant and started again.
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from srl.runtime.bus import session
from srl.runtime.bus.arrivals import Arrivals
from srl.runtime.bus.requests import Requests, reply
from srl.runtime.bus.status import Reporter
from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.descriptors import raise_limit
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.header import CYCLE, FLAG_DEGRADED
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import RequestWriter
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import attachment, cdr, messages
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import Keys, check

PUBLISHED = ("state", "command", "applied", "sent", "internal", "truth")  # roles
STATUS_PERIOD = 200_000_000  # ns
SILENT = 500_000_000  # ns without a sign of life, plus two periods, after which the loop counts as dead
MOST = 16  # rows published in one turn: a simulation faster than real time isn't followed row by row
LISTENERS = 50_000_000  # ns: a new subscriber hears its signal no later than this
NOTES_KEPT = 20
# The ring wakes nobody: a reader that hangs must cost the loop nothing. The bus looks when the next row to publish is
# due; a row that is late is looked for at this pace, and ever more seldom.
SOON, SELDOM = 1_000_000, 20_000_000  # ns between two looks, at least and at most
APPENDED = 200_000  # ns from the end of a cycle's last phase until its row is surely there
_CYCLE, _NOW, _WRITE = CYCLE.cycle, CYCLE.now, CYCLE.write
_STATE, _CAUSE, _FLAGS, _LATCHES = CYCLE.state, CYCLE.cause, CYCLE.flags, CYCLE.latches


class Bus:
    """The bus of one run; see the module's docstring."""

    def __init__(self, run_folder: RunFolder) -> None:
        """Opens the rings and the session. Raises SrlError."""
        self._layout = Layout.load(run_folder.layout)
        self._ring = RingReader(run_folder.rows, width=self._layout.width)
        meta = self._layout.meta
        self._layout.needs(str(run_folder.layout), "bus", "wall", "rate")
        config = BusConfig.model_validate(meta["bus"] or {})
        self._name = run_folder.path.name
        self._keys = Keys(self._name)
        self._fields = [f for f in self._layout.fields.values() if f.role in PUBLISHED and f.size]
        check((f.name for f in self._fields), "signal")
        check((p["name"] for p in meta.get("parameters", [])), "parameter")
        check((s["name"] for s in meta.get("setpoints", [])), "setpoint")
        self._ring.sequence = self._ring.head  # earlier rows are for the recorder
        self._request_ring = RequestWriter(run_folder.requests)
        self._events = EventReader(run_folder.events)
        self._remembered: deque[dict[str, Any]] = deque(maxlen=NOTES_KEPT)
        self._wall = int(meta["wall"])
        self._period = round(1e9 * meta["rate"][1] / meta["rate"][0])
        self._silence = SILENT + 2 * self._period
        self._decimate = config.decimate
        self._reporter = Reporter(self._name, self._layout)
        self._arrivals = Arrivals()
        counts = self._reporter.counts
        self._requests = Requests(self._layout, self._keys, self._request_ring, counts, self._arrivals)
        self._row = self._ring.newest()
        self._last_status: tuple[int, ...] | None = None  # state, cause and latches of the last status
        self._status_due = self._listeners_due = 0
        self._silent = False
        self._sent, self._sender = 0, os.urandom(16)  # for the samples' attachments: their number and sender
        self._session = session.serve(run_folder.bus_socket, config, self._keys)
        try:
            self._declare()
        except BaseException:
            self._session.close()
            raise

    def _declare(self) -> None:
        s = self._session

        def publisher(key: str, kind: str) -> zenoh.Publisher:
            # DROP: a slow subscriber loses samples. With BLOCK, a put was held up for 5 s.
            return s.declare_publisher(
                key,
                encoding=messages.encoding(kind),
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )

        self._signals = [
            (
                slice(f.offset, f.offset + f.size),
                e := messages.Encoder(f),
                publisher(self._keys.state(f.name), e.kind),
                self._layout.stamped_by(f),
            )
            for f in self._fields
        ]
        self._heard = self._signals[:0]  # those with a subscriber
        self._status_out = publisher(self._keys.status, messages.DIAGNOSTICS)
        self._events_out = publisher(self._keys.events, messages.STRING)
        self._declared: list[Any] = []
        for key, answer in self._requests.handlers().items():
            stops, aside = key in self._requests.stops(), self._requests.only_reads(key)
            into = self._arrivals.into_stops(answer, key) if stops else self._arrivals.into(answer, aside=aside)
            self._declared.append(s.declare_queryable(key, into))
        known = self._requests.known()
        for keys, answer in self._requests.strangers().items():
            into = self._arrivals.into(answer, unless=known, aside=self._requests.only_reads(keys))
            self._declared.append(s.declare_queryable(keys, into))
        for key, take in self._requests.subscribers().items():
            self._declared.append(s.declare_subscriber(key, self._arrivals.into(take)))
        for keys, tell in (
            (self._keys.states, self._describe),
            (self._keys.status, self._tell),
            (self._keys.events, self._recall),
        ):
            self._declared.append(s.declare_queryable(keys, self._arrivals.into(tell, aside=True)))
        # Declared last: a client that sees this token finds everything else declared.
        self._declared.append(s.liveliness().declare_token(self._keys.alive))

    def run(self, ending: Ending | None = None) -> None:
        """Runs until the ring is closed or this process is to end."""
        if ending is not None:
            ending.on_ask = self._arrivals.wake
        try:
            while ending is None or not ending.asked:
                self._turn()
                if self._ring.closed and self._ring.sequence >= self._ring.head:
                    break
                self._wait()
            self._requests.end()
            self._say_status()
        finally:
            self._session.close()
            self._request_ring.close()
            self._events.close()
            self._ring.close()

    def _wait(self) -> None:
        """Waits until the next turn is due, or until arriving items have been handled."""
        pause = SOON
        if not self._requests.busy:
            pause = SELDOM
            if self._row is not None:
                pause = next_look(self._row, int(self._every(self._row)), self._period, time.monotonic_ns())
        self._arrivals.handle(pause / 1e9)

    def _turn(self) -> None:
        rows = self._ring.take()
        if rows.shape[0]:
            self._row = rows[-1]
            self._publish(rows)  # first: all else may wait
            self._reporter.timing.add(rows)
        self._reporter.counts.lost_rows = self._ring.lost
        now = time.monotonic_ns()
        self._silent = not self._ring.closed and now - self._ring.beat > self._silence
        self._requests.turn(rows, self._row, self._silent or self._ring.closed)
        for change in self._changes(rows):
            self._row = change
            self._say_status()
        if rows.shape[0]:
            self._row = rows[-1]
        if now >= self._status_due:
            self._status_due = now + STATUS_PERIOD
            self._say_status()
            self._say_events()

    def _publish(self, rows: NDArray[np.int64]) -> None:
        due = rows[rows[:, _CYCLE] % self._every(rows) == 0][-MOST:]
        if due.shape[0]:
            self._see_who_listens()
        for row in due:
            floats = row[self._layout.ints :].view(np.float64)
            for place, encoder, publisher, column in self._heard:
                taken = int(row[column])
                if taken < 0:
                    continue  # the device has given no sample yet
                stamp = taken + self._wall
                self._sent += 1
                publisher.put(
                    encoder.encode(floats[place], stamp),
                    attachment=attachment.encode(self._sent, stamp, self._sender),
                )

    def _see_who_listens(self) -> None:
        """Asks zenoh, but not for each row: for all signals that takes as long as to publish one."""
        now = time.monotonic_ns()
        if now >= self._listeners_due:
            self._listeners_due = now + LISTENERS
            self._heard = [signal for signal in self._signals if session.has_subscriber(signal[2])]

    def _every(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Every how many-th cycle is published, as each row (..., width) says."""
        return np.where(rows[..., _FLAGS] & FLAG_DEGRADED, 2 * self._decimate, self._decimate)

    def _changes(self, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The rows at which the state, the cause or the latches change."""
        found = []
        for row in rows:
            status = int(row[_STATE]), int(row[_CAUSE]), int(row[_LATCHES])
            if status != self._last_status:
                self._last_status = status
                found.append(row)
        return found[-MOST:]

    def _say_status(self) -> None:
        self._status_out.put(self._status())

    def _status(self) -> bytes:
        return cdr.encode(messages.DIAGNOSTICS, self._reporter.message(self._row, time.time_ns(), self._silent))

    def _say_events(self) -> None:
        for event in self._events.take():
            self._remembered.append(
                asdict(event) | {"level": event.level.name.lower(), "time": event.time + self._wall_now()}
            )
            text = f"{event.level.name.lower()}: {event.text}"
            self._events_out.put(cdr.encode(messages.STRING, {"data": text}))

    @staticmethod
    def _wall_now() -> int:
        return time.time_ns() - time.monotonic_ns()

    def _describe(self, query: zenoh.Query) -> None:
        """Answers with the newest sample and the metadata of every signal whose key the query's expression matches."""
        row = self._row
        for field, (place, encoder, _, column) in zip(self._fields, self._signals, strict=True):
            key, meta = self._keys.state(field.name), self._keys.meta(field.name)
            if row is not None and int(row[column]) >= 0 and query.key_expr.intersects(zenoh.KeyExpr(key)):
                stamp = int(row[column]) + self._wall
                sample = encoder.encode(row[self._layout.ints :].view(np.float64)[place], stamp)
                reply(query, key, sample, messages.encoding(encoder.kind))
            if query.key_expr.intersects(zenoh.KeyExpr(meta)):
                reply(query, meta, messages.describe(field))
        query.drop()

    def _tell(self, query: zenoh.Query) -> None:
        reply(query, self._keys.status, self._status(), messages.encoding(messages.DIAGNOSTICS))
        query.drop()

    def _recall(self, query: zenoh.Query) -> None:
        reply(query, self._keys.events, list(self._remembered))
        query.drop()


def next_look(row: NDArray[np.int64], every: int, period: int, now: int) -> int:
    """Returns the ns until the ring is worth a look, SOON to SELDOM.

    Args:
        row: the newest row (width,).
        every: each how many-th cycle is published.
        period: ns from cycle to cycle.
        now: CLOCK_MONOTONIC ns.
    """
    ahead = every - int(row[_CYCLE]) % every
    return min(max(abs(int(row[_WRITE]) + ahead * period + APPENDED - now), SOON), SELDOM)


def main(arguments: list[str], ending: Ending) -> int:
    """Entry point of `python -m srl.runtime.bus RUNDIR`, which the supervisor starts. Returns the exit code.

    `ending` was made before this module's imports.
    """
    if ending.orphan:  # a bus that outlived its supervisor would keep the instance's name alive on the socket
        print("bus: the supervisor that started it has ended, so it doesn't begin", file=sys.stderr)
        return 1
    if len(arguments) != 1:
        print("usage: python -m srl.runtime.bus RUNDIR", file=sys.stderr)
        return 2
    raise_limit()  # clients that only connect take one each
    try:
        Bus(RunFolder(Path(arguments[0]))).run(ending)
    except (SrlError, OSError) as error:
        print(f"bus: {error}", file=sys.stderr)
        return 2
    return 0
