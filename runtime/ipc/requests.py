"""Requests to the loop, and the ring through which those of bus clients come, written by the bus, read by the loop.

The bus checks a request before it writes it. The loop repeats the checks that concern safety (finite, in bounds,
not expired). The answer needs no channel of its own: the loop writes the request's number and its result into
the row of the cycle that took it, and the sender reads it there.

Record (int64 words): id, kind, target, expires (CLOCK_MONOTONIC ns), count, origin, then `VALUES` float64 words. For a
parameter the last `NAME` of these are the sender's name for itself, UTF-8, zero-padded.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CLIENTS, Origin
from srl.runtime.ipc.ring import RingReader, RingWriter

VALUES = 64
NAME = 4  # words
_HEAD = 6
WIDTH = _HEAD + VALUES
CAPACITY = 1024


class RequestKind(IntEnum):
    """The kind of a request."""

    NONE = 0
    START = 1
    STOP = 2
    RESET = 3
    PARAMETER = 4  # target: the parameter's index in meta["parameters"], one value
    SETPOINT = 5  # target: index in meta["setpoints"], as many values as the signal has
    EXIT = 6  # safe stop, then end
    FAULT = 7  # target: a `words.Cause` seen outside the loop (the bus died, the duration is over)


# What a client of the bus may ask for. The rest is for the service itself.
_KINDS = frozenset(
    {RequestKind.START, RequestKind.STOP, RequestKind.RESET, RequestKind.PARAMETER, RequestKind.SETPOINT}
)
STATE_REQUESTS = frozenset(
    {RequestKind.START, RequestKind.STOP, RequestKind.RESET, RequestKind.EXIT, RequestKind.FAULT}
)


def permitted(origin: Origin, kind: RequestKind) -> bool:
    """Whether a sender of this origin may ask for it: an observer reads, parameters are the engineer's."""
    if origin is Origin.OBSERVER:
        return False
    return origin is not Origin.OPERATOR or kind is not RequestKind.PARAMETER


class Answer(IntEnum):
    """The result of a request."""

    NONE = 0
    DONE = 1
    REFUSED_STATE = 2  # not possible in this state
    REFUSED_FAULT = 3  # the cause of the stop is still present
    REFUSED_VALUE = 4  # not finite, out of bounds, wrong size
    EXPIRED = 5
    REFUSED_LATCH = 6  # a latch stands that its origin may not release
    REFUSED_RATE = 7  # too many of its origin
    OVERTAKEN = 8  # a stop came after it
    REFUSED_UNMEASURED = 9  # nothing measures where the limb is, and it would move by itself
    REFUSED_KEPT = 10  # a latch stands that nothing may release in this run
    REFUSED_ROLE = 11  # its sender's role may not ask for it


@dataclass(slots=True)
class Request:
    """One request. `id` is its number in the ring; 0 for one that came another way.

    `sender`: what the sender of a parameter calls itself; "" for none. Nobody checks it: it is for people alone.
    """

    id: int
    kind: RequestKind
    target: int
    expires: int
    values: Array
    origin: Origin
    sender: str = ""


class RequestWriter:
    """The bus process's side of the requests."""

    def __init__(self, path: Path) -> None:
        self._ring = RingWriter(path, WIDTH)
        self._words = np.zeros(WIDTH, np.int64)
        self._values = self._words[_HEAD:].view(np.float64)

    @staticmethod
    def create(path: Path) -> None:
        """Makes the file. The supervisor does this once a run."""
        RingWriter.create(path, WIDTH, CAPACITY).close()

    def send(
        self,
        kind: RequestKind,
        expires: int,
        target: int = 0,
        values: Array | None = None,
        origin: Origin = Origin.BUS,
        sender: str = "",
    ) -> int:
        """Appends a record; returns its id (the ring's sequence number).

        `origin`: one of CLIENTS. `sender`: of a parameter alone; a long one is cut.
        """
        count = 0 if values is None else values.size
        if count > VALUES:
            raise ValueError(f"{count} values in one request; {VALUES} at most")
        number = self._ring.head + 1
        self._words[:_HEAD] = number, kind, target, expires, count, origin
        if values is not None:
            self._values[:count] = values.ravel()
        if kind is RequestKind.PARAMETER:
            name = sender.encode(errors="replace")[: 8 * NAME].ljust(8 * NAME, b"\0")
            self._words[-NAME:] = np.frombuffer(name, np.int64)
        self._ring.append(self._words)
        return number

    def close(self) -> None:
        """Unmaps the file."""
        self._ring.close()


class RequestReader:
    """The loop's side of the requests."""

    def __init__(self, path: Path) -> None:
        self._ring = RingReader(path, width=WIDTH)
        self._ring.sequence = self._ring.head  # requests to an earlier loop do not concern this one

    def take(self) -> list[Request]:
        """Returns all new requests, oldest first. An empty list is the usual case and costs little."""
        if self._ring.head == self._ring.sequence:
            return []
        rows = [row for row in self._ring.take(CAPACITY) if int(row[1]) in _KINDS and int(row[5]) in CLIENTS]
        return [
            Request(
                int(row[0]),
                RequestKind(int(row[1])),
                int(row[2]),
                int(row[3]),
                row[_HEAD : _HEAD + int(row[4])].view(np.float64),
                Origin(int(row[5])),
                _sender(row) if int(row[1]) == RequestKind.PARAMETER else "",
            )
            for row in rows
        ]

    def close(self) -> None:
        """Unmaps the file."""
        self._ring.close()


def _sender(row: NDArray[np.int64]) -> str:
    """The name in a parameter's record, without what isn't printed."""
    name = row[-NAME:].tobytes().rstrip(b"\0").decode(errors="replace")
    return "".join(c for c in name if c.isprintable())
