"""The messages between the driver and its zenoh process: datagrams on a Unix socket, little endian.

Every message begins with its kind (one byte) and the number of its session (uint16). So messages that an earlier
session left in the socket are recognised.

To the process: O open (JSON), P publish, S stop, Q query (JSON), T query for liveliness tokens (JSON), C close.
From the process: R ready, F failed (text), D a sample, L a liveliness token appeared or vanished, K a command was
taken, A an answer, E end of the answers, X the connection is gone (text).
"""

from __future__ import annotations

import json
import struct
from typing import Any, NamedTuple

LARGEST = 65536  # greatest number of bytes of a payload that is passed on

_HEAD = struct.Struct("<cH")
_SAMPLE = struct.Struct("<cHHqqH")
_COMMAND = struct.Struct("<cHHIqqq")
_TAKEN = struct.Struct("<cHI")
_TOKEN = struct.Struct("<cHHB")
_ANSWER = struct.Struct("<cHH")


class Sample(NamedTuple):
    """A sample of a subscription.

    Attributes:
        source: index of the subscription.
        arrived: ns, CLOCK_MONOTONIC, when the process received it.
        stamp: ns, source time in the attachment; -1 if there is none.
        encoding: zenoh's, "application/cdr;sensor_msgs/msg/JointState".
        payload: its bytes.
    """

    source: int
    arrived: int
    stamp: int
    encoding: str
    payload: bytes


class Command(NamedTuple):
    """A command on its way to the peer.

    Attributes:
        outlet: index of the publisher.
        number: counts up; `Taken` repeats it.
        made, expires: ns, CLOCK_MONOTONIC.
        stamp: ns, the peer's clock at `made`; -1: unknown.
        payload: its bytes.
    """

    outlet: int
    number: int
    made: int
    expires: int
    stamp: int
    payload: bytes


class Taken(NamedTuple):
    """The newest command that the process has taken."""

    number: int


class Token(NamedTuple):
    """A liveliness token of subscription `source` appeared or vanished."""

    source: int
    alive: bool


class Answer(NamedTuple):
    """One answer to a query: its key and payload (empty for a token)."""

    key: str
    payload: bytes


class Words(NamedTuple):
    """A message R, F, E or X, with its text."""

    kind: bytes
    text: str


Event = Sample | Taken | Token | Answer | Words


def simple(kind: bytes, session: int, content: Any = None) -> bytes:
    """Encodes a message with JSON, with text, or with neither."""
    body = b"" if content is None else (content if isinstance(content, str) else json.dumps(content)).encode()
    return _HEAD.pack(kind, session) + body


def sample(session: int, item: Sample) -> bytes:
    """Encodes D."""
    encoding = item.encoding.encode()[:255]
    return _SAMPLE.pack(b"D", session, item.source, item.arrived, item.stamp, len(encoding)) + encoding + item.payload


def command(session: int, item: Command) -> bytes:
    """Encodes P."""
    return _COMMAND.pack(b"P", session, *item[:5]) + item.payload


def taken(session: int, number: int) -> bytes:
    """Encodes K."""
    return _TAKEN.pack(b"K", session, number)


def token(session: int, source: int, alive: bool) -> bytes:
    """Encodes L."""
    return _TOKEN.pack(b"L", session, source, alive)


def answer(session: int, key: str, payload: bytes) -> bytes:
    """Encodes A."""
    name = key.encode()
    return _ANSWER.pack(b"A", session, len(name)) + name + payload


def head(message: bytes) -> tuple[bytes, int]:
    """Returns kind and session of a message."""
    kind, session = _HEAD.unpack_from(message)
    return kind, session


def body(message: bytes) -> Any:
    """Decodes the JSON of O, Q and T."""
    return json.loads(message[_HEAD.size :])


def read_command(message: bytes) -> Command:
    """Decodes P."""
    _, _, outlet, number, made, expires, stamp = _COMMAND.unpack_from(message)
    return Command(outlet, number, made, expires, stamp, message[_COMMAND.size :])


def read_event(message: bytes) -> Event:
    """Decodes any message from the process."""
    kind = message[:1]
    if kind == b"D":
        _, _, source, arrived, stamp, length = _SAMPLE.unpack_from(message)
        at = _SAMPLE.size + length
        return Sample(source, arrived, stamp, message[_SAMPLE.size : at].decode("utf-8", "replace"), message[at:])
    if kind == b"K":
        return Taken(_TAKEN.unpack_from(message)[2])
    if kind == b"L":
        return Token(_TOKEN.unpack_from(message)[2], bool(message[_TOKEN.size - 1]))
    if kind == b"A":
        at = _ANSWER.size + _ANSWER.unpack_from(message)[2]
        return Answer(message[_ANSWER.size : at].decode("utf-8", "replace"), message[at:])
    return Words(kind, message[_HEAD.size :].decode("utf-8", "replace"))
