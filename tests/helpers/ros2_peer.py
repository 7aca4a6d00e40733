"""A ROS 2 peer that isn't ours (zenoh-ros2-sdk's session), its router, and a run that is a node."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh
from rosbags.typesys import Stores
from zenoh import ext

from helpers import ros2_types
from helpers.run import Running
from helpers.wait import until
from srl.runtime.ros2.names import HASHES, TRIGGER, dds_type

sdk = pytest.importorskip("zenoh_ros2_sdk")
discovery = pytest.importorskip("zenoh_ros2_sdk.discovery")
STORE = ros2_types.store(Stores.ROS2_JAZZY)
ATTACHMENT = bytes(16) + b"\x10" + bytes(16)  # ROS 2's: number, time, and the 16 bytes of the sender


@contextmanager
def router(port: int) -> Iterator[None]:
    """What `rmw_zenohd` is: a zenoh router."""
    content = {
        "mode": "router", "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}},
        "routing": {"router": {"peers_failover_brokering": False}},  # as rmw_zenohd has it since December 2024
    }  # fmt: skip
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
    try:
        yield
    finally:
        session.close()


class Peer:
    """The stranger's session, at one router."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.manager = sdk.ZenohSession.get_instance("127.0.0.1", port)

    def topics(self) -> dict[str, str]:
        """Names and types, as `ros2 topic list -t` shows them."""
        found = discovery.get_topic_names_and_types(0, "127.0.0.1", self.port, timeout=1.0)
        return {name: kinds[0] for name, kinds in found}

    def tokens(self, kind: str) -> list[str]:
        """The liveliness tokens of a kind."""
        given = self.manager.session.liveliness().get(f"@ros2_lv/**/{kind}/**", timeout=1.0)
        return [str(reply.ok.key_expr) for reply in given if reply.ok is not None]

    def echo(self, topic: str, kind: str, latched: bool = False) -> Any:
        """The next message of a topic, decoded by rosbags; of a latched one, the last from before."""
        key = self.key(topic, kind)
        taken: list[Any] = []
        session = self.manager.session
        if latched:
            subscriber: Any = ext.declare_advanced_subscriber(
                session, key, taken.append, history=ext.HistoryConfig(detect_late_publishers=True)
            )
        else:
            subscriber = session.declare_subscriber(key, taken.append)
        until(lambda: taken, what=topic)
        subscriber.undeclare()
        assert len(taken[-1].attachment.to_bytes()) == 33
        return STORE.deserialize_cdr(taken[-1].payload.to_bytes(), kind)

    def key(self, name: str, kind: str) -> str:
        """The key of a topic or service."""
        return f"0{name}/{dds_type(kind)}/RIHS01_{HASHES[kind]}"

    def send(self, topic: str, kind: str, payload: bytes) -> None:
        """Publishes CDR."""
        self.manager.session.put(self.key(topic, kind), payload, attachment=ATTACHMENT)

    def call(self, service: str, kind: str, request: Any, timeout: float = 20.0) -> Any:
        """Calls a service; the request and the answer are rosbags' objects."""
        payload = bytes(STORE.serialize_cdr(request, f"{kind}_Request"))
        session = self.manager.session
        (reply,) = list(session.get(self.key(service, kind), payload=payload, attachment=ATTACHMENT, timeout=timeout))
        return STORE.deserialize_cdr(reply.ok.payload.to_bytes(), f"{kind}_Response")

    def trigger(self, service: str) -> tuple[bool, str]:
        """Calls a std_srvs/srv/Trigger."""
        key = self.key(service, TRIGGER)
        gid = bytes(range(16))
        attachment = (7).to_bytes(8, "little") + time.time_ns().to_bytes(8, "little") + b"\x10" + gid
        (reply,) = list(self.manager.session.get(key, payload=b"\0\1\0\0\0", attachment=attachment, timeout=10.0))
        answered = reply.ok.attachment.to_bytes()
        assert answered[:8] == attachment[:8]
        assert answered[17:] == gid
        payload = reply.ok.payload.to_bytes()
        size = int.from_bytes(payload[8:12], "little")
        return bool(payload[4]), payload[12 : 12 + size - 1].decode()


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def node(folder: Path, port: int, profile: str, *more: str, **options: Any) -> Iterator[Running]:
    ros2 = json.dumps({"router": f"tcp/127.0.0.1:{port}"} | options)
    instance = more[1] if "--instance" in more else profile
    with Running(folder, profile, "--sim", "--set", f"bus.ros2={ros2}", *more, instance=instance) as run:
        run.started()
        yield run


@pytest.fixture
def peer(port: int) -> Iterator[Callable[[], Peer]]:
    made: list[Peer] = []

    def join() -> Peer:
        made.append(Peer(port))
        return made[-1]

    yield join
    for each in made:
        each.manager.close()
