"""`--foxglove` against an independent client: the run's topics are there, but only with the key, and nobody waits."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
from helpers.foxglove import DATA, FoxgloveProcess, Viewer, viewing
from helpers.operator_page import UPGRADE, get
from helpers.viewed import WALL, ViewedLoop
from helpers.wait import until
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed, InvalidStatus

from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import CYCLE, State

STORE = get_typestore(Stores.ROS2_JAZZY)
OFFER = {"Sec-WebSocket-Protocol": "foxglove.sdk.v1"}


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewedLoop]:
    with ViewedLoop(tmp_path_factory.mktemp("f") / "run").running() as made:
        until(lambda: made.cycle > 2)
        yield made


@pytest.fixture(scope="module")
def served(loop: ViewedLoop) -> Iterator[FoxgloveProcess]:
    with FoxgloveProcess(loop.folder.path) as made:
        yield made


def status_of(served: FoxgloveProcess, path: str, **headers: str) -> int:
    """Of an attempt to connect."""
    return get(served, path, **UPGRADE | OFFER | headers).status


def test_a_client_gets_the_topics_as_the_recording_has_them(served: FoxgloveProcess, loop: ViewedLoop) -> None:
    async def look() -> Viewer:
        async with viewing(served.address) as viewer:
            await viewer.subscribe("/law/c", "/loop/cycle", "/rosout")
            await viewer.until("/law/c", "/loop/cycle", count=3)
            loop.events.write(time.monotonic_ns(), Level.WARNING, 7, "a finger was lost")
            await viewer.until("/rosout")
            return viewer

    viewer = asyncio.run(look())
    assert viewer.info["capabilities"] == []  # one can look, and nothing else
    for channel in viewer.channels.values():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        get_types_from_msg(channel["schema"], channel["schemaName"])  # rosbags reads the definition
    stamp, payload = viewer.data["/law/c"][-1]
    assert min(abs(stamp - WALL - 1e6 * t) for t in loop.times) < 1e3
    assert STORE.deserialize_cdr(payload, "std_msgs/msg/Float64MultiArray").data.tolist() == [loop.value]
    words = [STORE.deserialize_cdr(p, "std_msgs/msg/Int64MultiArray").data for _, p in viewer.data["/loop/cycle"]]
    assert words[0][0] < words[1][0] < words[2][0]  # the cycle's number goes on
    log = STORE.deserialize_cdr(viewer.data["/rosout"][-1][1], "rcl_interfaces/msg/Log")
    assert (log.msg, log.level, log.function) == ("a finger was lost", 30, "cycle 7")


def test_the_messages_are_those_of_foxglove_s_own_server(served: FoxgloveProcess) -> None:
    foxglove = pytest.importorskip("foxglove")
    schema = foxglove.Schema(name="std_msgs/msg/String", encoding="ros2msg", data=b"string data\n")
    theirs = foxglove.Channel("/words", message_encoding="cdr", schema=schema, metadata={"unit": "1"})
    server = foxglove.start_server(port=0)

    async def log() -> None:  # a subscription there has only what is logged after it
        while True:
            theirs.log(b"\0\1\0\0\2\0\0\0a\0")
            await asyncio.sleep(0.01)

    async def look(address: str, topic: str) -> Viewer:
        logger = asyncio.create_task(log())
        async with viewing(address) as viewer:
            await viewer.subscribe(topic)
            await viewer.until(topic)
        logger.cancel()
        return viewer

    try:
        one = asyncio.run(look(f"ws://127.0.0.1:{server.port}", "/words"))
        ours = asyncio.run(look(served.address, "/law/c"))
    finally:
        server.stop()
    assert ours.info.keys() - {"name"} == one.info.keys() - {"name"}
    assert ours.channels["/law/c"].keys() == one.channels["/words"].keys()
    for mine, other in zip(ours.channels["/law/c"].values(), one.channels["/words"].values(), strict=True):
        assert type(mine) is type(other)


def test_nobody_without_the_key_sees_the_run(served: FoxgloveProcess) -> None:
    key = urlsplit(served.address).path
    assert len(key) > 24
    for path in ("/", "/socket", key[:-1], key + "x", key + "/", key.upper(), f"/?key={key[1:]}", "/%00"):
        assert status_of(served, path) in (403, 404), path
    assert status_of(served, key) == 101

    async def wrong() -> None:
        async with viewing(served.address[:-1]):
            pass

    with pytest.raises(InvalidStatus, match="403"):
        asyncio.run(wrong())


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("https://app.foxglove.dev", 101), ("file://", 101), ("http://localhost:8080", 101), ("http://127.0.0.1", 101),
        ("https://app.foxglove.dev.example", 403), ("http://app.foxglove.dev", 403), ("https://example.org", 403),
        ("null", 403), ("http://localhost.example", 403), ("http://[", 403), ("", 403),
    ],
)  # fmt: skip
def test_a_page_from_elsewhere_is_refused_even_with_the_key(served: FoxgloveProcess, origin: str, status: int) -> None:
    assert status_of(served, urlsplit(served.address).path, Origin=origin) == status


def test_another_host_s_name_is_refused(served: FoxgloveProcess) -> None:
    key, port = urlsplit(served.address).path, urlsplit(served.address).port
    assert status_of(served, key, Host=f"localhost:{port}") == 101
    for host in ("rebound.example", f"rebound.example:{port}", "127.0.0.1", ""):
        assert status_of(served, key, Host=host) == 421, host


def test_it_listens_on_this_machine_alone(served: FoxgloveProcess) -> None:
    port = urlsplit(served.address).port
    assert port is not None
    with socket.socket() as other:
        other.settimeout(5)
        assert other.connect_ex(("127.0.0.2", port)) != 0


def test_another_protocol_is_refused_and_what_it_cannot_do_is_said(served: FoxgloveProcess) -> None:
    assert status_of(served, urlsplit(served.address).path, **{"Sec-WebSocket-Protocol": "chat"}) == 400

    async def ask() -> list[dict[str, object]]:
        async with viewing(served.address, protocol="foxglove.websocket.v1") as viewer:
            await viewer.tell(op="setParameters", parameters=[])
            while not viewer.said:
                await viewer.hear()
            return viewer.said

    (said,) = asyncio.run(ask())
    assert "one can only look" in str(said["message"])


@pytest.mark.parametrize(
    "message", ["[]", "{}", "x", '{"op":"subscribe","subscriptions":[{"id":1,"channelId":999}]}', b"\1"]
)
def test_a_message_outside_the_protocol_ends_the_connection(served: FoxgloveProcess, message: str | bytes) -> None:
    async def say() -> None:
        async with viewing(served.address) as viewer:
            await viewer.socket.send(message)
            while True:
                await viewer.hear()

    with pytest.raises(ConnectionClosed) as closed:
        asyncio.run(say())
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008


class HeavyLoop(ViewedLoop):
    """Its rows have a signal of 16 kB."""

    def begin(self) -> None:
        self.layout.add("law.much", "internal", (2000,), "1")
        super().begin()

    def step(self, at: float | None = None) -> None:
        self.cycle += 1
        row = np.zeros(self.layout.width, np.int64)
        now = time.monotonic_ns()
        for word in ("now", "control"):
            row[getattr(CYCLE, word)] = now
        row[CYCLE.cycle], row[CYCLE.state] = self.cycle, self.state
        row[self.layout.device(0)][:2] = now, self.link
        self.ring.append(row)


@pytest.mark.slow
def test_a_slow_client_misses_pictures_and_delays_nobody(tmp_path: Path) -> None:
    heavy = HeavyLoop(tmp_path / "run")

    async def look(address: str) -> tuple[int, int, int]:
        async with viewing(address) as slow, viewing(address) as quick:
            much = slow.channels["/law/much"]["id"]
            entries = [{"id": i, "channelId": much} for i in range(300)]  # 5 MB a picture: no socket holds many
            await slow.tell(op="subscribe", subscriptions=entries)
            slow.socket.transport.pause_reading()
            await quick.subscribe("/loop/cycle")
            await quick.until("/loop/cycle", count=90)
            memory = psutil.Process(served.process.pid).memory_info().rss
            newest = quick.data["/loop/cycle"][-1][0]
            slow.socket.transport.resume_reading()
            pictures, stamp = set(), 0
            while stamp < newest:
                _, _, stamp = DATA.unpack_from(await slow.socket.recv())
                pictures.add(stamp)
            return len(pictures), len(quick.data["/loop/cycle"]), memory

    with heavy.running():
        until(lambda: heavy.cycle > 2)
        with FoxgloveProcess(heavy.folder.path) as served:
            before = psutil.Process(served.process.pid).memory_info().rss
            slow, quick, memory = asyncio.run(look(served.address))
    assert quick >= 90
    assert slow < quick / 3  # those that it missed were never kept for it
    assert memory - before < 100e6  # of 450 MB


def test_how_the_run_is_is_said(served: FoxgloveProcess, loop: ViewedLoop) -> None:
    async def look() -> list[tuple[str, str]]:
        async with viewing(served.address) as viewer:
            loop.state = State.STOPPED
            while not any(said["op"] == "status" for said in viewer.said):
                await viewer.hear()
            loop.state = State.ACTIVE
            while not any(said["op"] == "removeStatus" for said in viewer.said):
                await viewer.hear()
            return [(said["op"], said.get("message", "")) for said in viewer.said]

    assert ("status", "The limb is stopped (none)") in asyncio.run(look())


def test_the_end_of_the_run_ends_it_and_without_a_run_there_is_none(tmp_path: Path) -> None:
    loop = ViewedLoop(tmp_path / "run")
    loop.step()
    with FoxgloveProcess(loop.folder.path) as served:
        loop.ring.finish()
        assert served.process.wait(30) == 0
    none = [sys.executable, "-m", "srl.runtime.web.foxglove", str(tmp_path)]
    ended = subprocess.run(none, check=False, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2
    assert ended.stderr.startswith("foxglove: ")
    assert "Traceback" not in ended.stderr
