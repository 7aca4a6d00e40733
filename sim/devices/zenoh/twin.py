"""Another runtime's bus or a robot's zenoh: a door that speaks zenoh on loopback, and a remote device's twin."""

from __future__ import annotations

import json
import os
import queue
import socket
import time
from typing import Any, Literal, NamedTuple

import zenoh

from srl.drivers.zenoh.config import SignalEntry
from srl.runtime.contracts.errors import HostError, WiringError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Signal
from srl.runtime.messages import attachment, messages
from srl.sim.devices.shared.sockets import SocketTwin, free_port
from srl.sim.devices.shared.stream_twin import Due
from srl.sim.devices.zenoh.fake import FakeZenoh

CATCH_UP = 11  # most samples sent at once
_WAITING = 4096  # most samples and queries in the queue; further ones are dropped


class Arrival(NamedTuple):
    """A client's sample, or its query (then `query` is set)."""

    key: str
    payload: bytes
    attachment: bytes
    query: zenoh.Query | None


class ZenohDoor:
    """A zenoh session that listens on loopback and queues what clients send.

    Attributes:
        address: `tcp://127.0.0.1:PORT`; "" while closed. The port stays the same after close and open.
        bytes_in, bytes_out: bytes of payloads.
        lost: bytes that came while the queue was full.
    """

    def __init__(self, mode: Literal["router", "peer"], subscribe: list[str], answer: list[str], tokens: list[str]):
        """
        Args:
            mode: zenoh's mode; a ROS 2 bridge is a router, a runtime a peer.
            subscribe: keys whose samples are received.
            answer: keys at which queries are received.
            tokens: liveliness tokens; ZID in a token stands for the session's id.
        """
        self._mode: str = mode
        self._subscribe, self._answer, self._tokens = subscribe, answer, tokens
        self.address = ""
        self.bytes_in = self.bytes_out = self.lost = 0
        self._port = 0
        self._arrived: queue.SimpleQueue[Arrival] = queue.SimpleQueue()
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: list[Any] = []

    @property
    def is_open(self) -> bool:
        """Whether clients can connect."""
        return self._session is not None

    def open(self, port: int = 0) -> None:
        """Listens; uses the previous port again, if there was one.

        Raises:
            HostError: the port is already in use.
        """
        self.close()
        self._port = port or self._port or free_port(socket.SOCK_STREAM)  # zenoh doesn't report which it was given
        endpoint = f"tcp/127.0.0.1:{self._port}"
        config = {
            "mode": self._mode,
            "listen": {"endpoints": [endpoint], "exit_on_failure": True},
            "connect": {"endpoints": []},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": False},
            "transport": {"shared_memory": {"enabled": False}},
        }
        try:
            session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        except zenoh.ZError:
            raise HostError(endpoint, "a twin can't listen there", "Choose another port") from None
        self._session = session
        for key in self._subscribe:
            self._declared.append(session.declare_subscriber(key, self._take))
        for key in self._answer:
            self._declared.append(session.declare_queryable(key, self._question))
        for token in self._tokens:
            name = token.replace("ZID", str(session.info.zid()))
            self._declared.append(session.liveliness().declare_token(name))
        self.address = f"tcp://127.0.0.1:{self._port}"

    def _take(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        if self._arrived.qsize() >= _WAITING:
            self.lost += len(payload)
            return
        self.bytes_in += len(payload)
        extra = sample.attachment
        self._arrived.put(Arrival(str(sample.key_expr), payload, b"" if extra is None else extra.to_bytes(), None))

    def _question(self, query: zenoh.Query) -> None:
        if self._arrived.qsize() < _WAITING:
            self._arrived.put(Arrival(str(query.key_expr), b"", b"", query))

    def read(self) -> list[Arrival]:
        """Samples and queries of clients, oldest first; never blocks. An unanswered query ends without an answer."""
        found = []
        while True:
            try:
                found.append(self._arrived.get_nowait())
            except queue.Empty:
                return found

    def write(self, key: str, payload: bytes, encoding: str = "", extra: bytes | None = None) -> None:
        """Publishes; drops the sample if a client is too slow. Does nothing while closed."""
        if self._session is None:
            return
        if key not in self._publishers:
            self._publishers[key] = self._session.declare_publisher(
                key, encoding=encoding or None, congestion_control=zenoh.CongestionControl.DROP, express=True
            )
        self._publishers[key].put(payload, attachment=extra)
        self.bytes_out += len(payload)

    def close(self) -> None:
        """Closes the session; clients see the connection end. Always succeeds."""
        session, self._session = self._session, None
        self._publishers.clear()
        self._declared.clear()
        self.address = ""
        if session is not None:
            session.close()


class ZenohTwin(SocketTwin):
    """The other machine: publishes the fake's signals at their keys, with time stamps of its own clock.

    Keys of another runtime (`srl/NAME/...`) have its metadata, liveliness token and attachments, and declare their
    message. Other keys, like those of a ROS 2 bridge, have no metadata, token or attachments. They declare their
    message only if the profile gives no `type`.
    """

    def __init__(self, fake: FakeZenoh) -> None:
        super().__init__(fake)
        self._fake = fake
        self._fields: list[tuple[Field, SignalEntry, messages.Encoder]] = []
        for signal in fake.states:
            entry = fake.config.signals[signal.name]
            field = _field(fake.name, signal, entry)
            self._fields.append((field, entry, messages.Encoder(field)))
        instances = sorted({e.instance for _, e, _ in self._fields if e.instance is not None})
        self.door = ZenohDoor(
            "peer", [], [f"srl/{name}/state/**" for name in instances], [f"srl/{name}/alive" for name in instances]
        )
        self._wall = 0
        self._due = Due(fake, CATCH_UP)
        self._count = 0
        self._sender = os.urandom(16)

    def doors(self) -> list[Any]:
        return [self.door]

    def opened(self) -> None:
        self._wall = time.time_ns() - time.monotonic_ns()
        self._due.begin()

    def work(self, now: int) -> None:
        for arrival in self.door.read():
            if arrival.query is not None:
                self._describe(arrival.query)
        for number, values in self._due.take():
            self._send(values, now - (self._fake.world.time - self._fake.taken_at(number)) + self._wall)

    def _send(self, values: Any, stamp: int) -> None:
        at = 0
        for field, entry, encoder in self._fields:
            payload = encoder.encode(values[at : at + field.size].reshape(field.shape), stamp)
            at += field.size
            if entry.instance is None:
                self.door.write(entry.key, payload, "" if entry.type else messages.encoding(encoder.kind))
                continue
            self._count += 1
            extra = attachment.encode(self._count, stamp, self._sender)
            self.door.write(entry.key, payload, messages.encoding(encoder.kind), extra)

    def _describe(self, query: zenoh.Query) -> None:
        for field, entry, _ in self._fields:
            key = f"{entry.key}/meta"
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(key, json.dumps(messages.describe(field)), encoding=messages.JSON)
        query.drop()


_NAME_OF = {  # name of a signal for which the runtime chooses each message
    messages.JOINT_STATE: "position",
    messages.POSE: "pose",
    messages.WRENCH: "wrench",
    messages.TWIST: "twist",
    messages.MULTI_ARRAY: "values",
}


def _field(device: str, signal: Signal, entry: SignalEntry) -> Field:
    """The signal as the other side has it; the end of its key selects the message, unless `type` does."""
    term = entry.key.rpartition("/")[2]
    if entry.type is not None:
        if entry.type not in _NAME_OF:
            raise WiringError(
                f"devices.{device}.signals.{signal.name}.type",
                f"the twin doesn't send {entry.type}",
                f"It sends {', '.join(_NAME_OF)}",
            )
        term = entry.field or _NAME_OF[entry.type]
    return Field(
        f"{device}.{term}",
        "state",
        0,
        signal.shape,
        signal.unit,
        frame=signal.frame,
        labels=signal.labels,
        slots=signal.slots,
        components=signal.components,
    )
