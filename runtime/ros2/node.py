"""A node of ROS 2's graph over zenoh: publishers, subscriptions, services and their tokens. No ROS 2 is needed.

The session connects to a router and goes on trying while there is none.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh import ext

from srl.runtime.bus.session import client_tls
from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.messages import attachment, messages
from srl.runtime.profile.bus import Ros2Config
from srl.runtime.ros2.names import NodeName, Qos, type_hash

LONGEST_MESSAGE = 1 << 17  # bytes of what a peer sends


class Publisher:
    """A topic's publisher; each sample bears its number, time and sender."""

    def __init__(self, publisher: Any, matching: Callable[[], bool]) -> None:
        self._publisher, self._matching = publisher, matching
        self._sent, self._sender = 0, os.urandom(16)

    @property
    def heard(self) -> bool:
        """Whether there is a subscriber."""
        return self._matching()

    def put(self, payload: bytes, stamp: int | None = None) -> None:
        """Publishes CDR. `stamp`: Unix ns; left out: now."""
        self._sent += 1
        when = time.time_ns() if stamp is None else stamp
        self._publisher.put(payload, attachment=attachment.encode(self._sent, when, self._sender))


class Node:
    """The node; see the module's docstring."""

    def __init__(self, config: Ros2Config, tls: TlsConfig | None, instance: str) -> None:
        """Opens the session. Raises HostError: zenoh refuses the options.

        Args:
            config: the profile's.
            tls: of the bus, for a router over TLS.
            instance: the run's name, which is the node's, and its namespace where the profile names none.
        """
        self._distribution = config.distribution
        content: dict[str, Any] = {
            "mode": "peer",
            "connect": {
                "endpoints": [config.router], "timeout_ms": 0, "exit_on_failure": False,
                "retry": {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5},
            },
            "listen": {"endpoints": []},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
            "adminspace": {"enabled": False},
            "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
            "transport": {"shared_memory": {"enabled": False}, "link": {"rx": {"max_message_size": LONGEST_MESSAGE}}},
        }  # fmt: skip
        if tls is not None:
            content["transport"]["link"]["tls"] = client_tls(tls)
        try:
            self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
        except zenoh.ZError as error:
            raise HostError("bus.ros2", f"zenoh can't be opened: {error}", "Check 'router'") from None
        namespace = f"/{instance}" if config.namespace is None else config.namespace.rstrip("/")
        self.name = NodeName(config.domain, str(self.session.zid()), namespace, instance)
        self._entities = 0
        self._declared: list[Any] = [self.session.liveliness().declare_token(self.name.alive)]

    def publisher(self, topic: str, kind: str, qos: Qos | None = None) -> Publisher:
        """Declares a publisher. `topic`: below the namespace, or from `/` on."""
        qos = qos or Qos()
        hashed = type_hash(kind, self._distribution)
        key = self.name.data_key(topic, kind, hashed)
        # DROP: a subscriber that reads too slowly loses samples and delays nobody.
        common: dict[str, Any] = {
            "encoding": messages.encoding(kind), "congestion_control": zenoh.CongestionControl.DROP, "express": True,
        }  # fmt: skip
        if qos.latched:
            made: Any = ext.declare_advanced_publisher(
                self.session, key, cache=ext.CacheConfig(max_samples=qos.depth), publisher_detection=True, **common
            )
            matching: Callable[[], bool] = lambda: True  # noqa: E731  (what is latched is always put)
        else:
            made = self.session.declare_publisher(key, **common)
            matching = lambda: bool(getattr(made.matching_status, "matching", made.matching_status))  # noqa: E731
        self._declared.append(made)
        self._announce("MP", topic, kind, qos)
        return Publisher(made, matching)

    def subscribe(self, topic: str, kind: str, take: Callable[[zenoh.Sample], None]) -> None:
        """Declares a subscription. `take` runs in a thread of zenoh's."""
        key = self.name.data_key(topic, kind, type_hash(kind, self._distribution))
        self._declared.append(self.session.declare_subscriber(key, take))
        self._announce("MS", topic, kind, Qos())

    def service(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> None:
        """Declares a service. `answer`: the request's CDR to the response's, in a thread of zenoh's."""
        key = self.name.data_key(name, kind, type_hash(kind, self._distribution))

        def take(query: zenoh.Query) -> None:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            given = b"" if query.attachment is None else query.attachment.to_bytes()
            with query:
                if attachment.is_one(given):  # the reply bears the request's number and its sender
                    query.reply(key, answer(payload), attachment=attachment.answer(given, time.time_ns()))

        self._declared.append(self.session.declare_queryable(key, take, complete=True))
        self._announce("SS", name, kind, Qos())

    def _announce(self, role: str, name: str, kind: str, qos: Qos) -> None:
        self._entities += 1
        hashed = type_hash(kind, self._distribution)
        alive = self.name.entity(self._entities, role, name, kind, hashed, qos)
        self._declared.append(self.session.liveliness().declare_token(alive))

    def close(self) -> None:
        """Ends the session: all tokens go."""
        self._declared.clear()
        self.session.close()
