"""A node of ROS 2's graph over zenoh: publishers, subscriptions, services and their tokens. No ROS 2 is needed.

The session is a client of the router: all goes through it, and the node dials nobody else.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import zenoh
from zenoh import ext

from srl.runtime.bus.session import client_tls, has_subscriber
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.messages import attachment, messages
from srl.runtime.profile.bus import Ros2Config
from srl.runtime.ros2.names import NodeName, Qos, definition, gid, type_hash

LONGEST_MESSAGE = 1 << 17  # bytes of what a peer sends


class Publisher:
    """A topic's publisher; each sample bears its number, time and sender."""

    def __init__(self, publisher: Any, heard: Callable[[], bool], sender: bytes) -> None:
        """`sender`: its gid."""
        self._publisher, self._heard, self._sender = publisher, heard, sender
        self._sent = 0

    @property
    def heard(self) -> bool:
        """Whether there is a subscriber."""
        return self._heard()

    def put(self, payload: bytes, stamp: int | None = None) -> None:
        """Publishes CDR. `stamp`: Unix ns; left out: now."""
        self._sent += 1
        when = time.time_ns() if stamp is None else stamp
        self._publisher.put(payload, attachment=attachment.encode(self._sent, when, self._sender))


class Call:
    """A request of a service, which is answered once."""

    def __init__(self, query: zenoh.Query, key: str) -> None:
        self._query, self._key = query, key

    @property
    def payload(self) -> bytes:
        """The request's CDR."""
        given = self._query.payload
        return b"" if given is None else given.to_bytes()

    def answer(self, payload: bytes) -> None:
        """Replies with CDR: the reply bears the request's number and its sender."""
        given = self._query.attachment
        assert given is not None
        with self._query:
            made = attachment.answer(given.to_bytes(), time.time_ns())
            self._query.reply(self._key, payload, attachment=made)


def connect(config: Ros2Config, tls: TlsConfig | None) -> zenoh.Session | None:
    """Opens a session with the router; None: it isn't there. Later losses it mends by itself."""
    content: dict[str, Any] = {
        "mode": "client",
        "connect": {
            "endpoints": [config.router], "timeout_ms": 500, "exit_on_failure": True,
            "retry": {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
        "transport": {"shared_memory": {"enabled": False}, "link": {"rx": {"max_message_size": LONGEST_MESSAGE}}},
    }  # fmt: skip
    if tls is not None:
        content["transport"]["link"]["tls"] = client_tls(tls)
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
    except zenoh.ZError:
        return None


class Node:
    """The node; see the module's docstring."""

    def __init__(self, session: zenoh.Session, config: Ros2Config, instance: str) -> None:
        """
        Args:
            session: of `connect`; it is closed with the node.
            config: the profile's.
            instance: the run's name, which is the node's, and its namespace where the profile names none.
        """
        self._distribution = config.distribution
        self.session = session
        namespace = f"/{instance}" if config.namespace is None else config.namespace.rstrip("/")
        self.name = NodeName(config.domain, str(session.zid()), namespace, instance)
        self._entities = 0
        self._declared: list[Any] = [session.liveliness().declare_token(self.name.alive)]

    def publisher(self, topic: str, kind: str, qos: Qos | None = None) -> Publisher:
        """Declares a publisher. `topic`: below the namespace, or from `/` on."""
        qos = qos or Qos()
        key = self._key(topic, kind)
        # DROP: a subscriber that reads too slowly loses samples and delays nobody.
        common: dict[str, Any] = {
            "encoding": messages.encoding(kind), "congestion_control": zenoh.CongestionControl.DROP, "express": True,
        }  # fmt: skip
        if qos.transient_local:
            made: Any = ext.declare_advanced_publisher(
                self.session, key, cache=ext.CacheConfig(max_samples=qos.depth), publisher_detection=True, **common
            )
            heard: Callable[[], bool] = lambda: True  # noqa: E731  (who comes late gets it, too)
        else:
            made = self.session.declare_publisher(key, **common)
            heard = partial(has_subscriber, made)
        self._declared.append(made)
        return Publisher(made, heard, gid(self._announce("MP", topic, kind, qos)))

    def subscribe(self, topic: str, kind: str, take: Callable[[zenoh.Sample], None]) -> None:
        """Declares a subscription. `take` gets each sample, in a thread of zenoh's, and must not block."""
        self._declared.append(self.session.declare_subscriber(self._key(topic, kind), take))
        self._announce("MS", topic, kind, Qos())

    def payload(self, sample: zenoh.Sample, topic: str, kind: str) -> bytes | None:
        """A sample's CDR; None: it was put by wildcard or without ROS 2's attachment, so it is none of this topic."""
        given = b"" if sample.attachment is None else sample.attachment.to_bytes()
        is_own = str(sample.key_expr) == self._key(topic, kind) and attachment.is_one(given)
        return sample.payload.to_bytes() if is_own else None

    def service(self, name: str, kind: str, take: Callable[[Call], None]) -> None:
        """Declares a service. `take` gets each call, in a thread of zenoh's, and must not block."""
        key = self._key(name, kind)

        def arrive(query: zenoh.Query) -> None:
            given = b"" if query.attachment is None else query.attachment.to_bytes()
            if str(query.key_expr) == key and attachment.is_one(given):
                take(Call(query, key))
            else:
                query.drop()  # a query by wildcard sets nothing in motion

        self._declared.append(self.session.declare_queryable(key, arrive, complete=True))
        self._announce("SS", name, kind, Qos())

    def _key(self, name: str, kind: str) -> str:
        return self.name.data_key(name, kind, type_hash(kind, self._distribution))

    def definition(self, kind: str) -> str:
        """The name in `cdr.TYPES` of a type as this node's distribution has it."""
        return definition(kind, self._distribution)

    def _announce(self, role: str, name: str, kind: str, qos: Qos) -> str:
        self._entities += 1
        hashed = type_hash(kind, self._distribution)
        alive = self.name.entity(self._entities, role, name, kind, hashed, qos)
        self._declared.append(self.session.liveliness().declare_token(alive))
        return alive

    def close(self) -> None:
        """Ends the session: all tokens go."""
        self._declared.clear()
        self.session.close()
