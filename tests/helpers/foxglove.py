"""A client of Foxglove's websocket protocol on another's websocket library, and the process that serves a run to it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import struct
import subprocess
import sys
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

PROTOCOL = "foxglove.sdk.v1"
DATA = struct.Struct("<BIQ")  # MessageData of the protocol: opcode 1, subscription, log time
PATIENCE = 30.0  # s


class FoxgloveProcess:
    """`python -m srl.runtime.web.foxglove`; a context manager that leaves no process.

    Attributes:
        address: the one that it printed.
    """

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "srl.runtime.web.foxglove", str(folder)], stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        line = self.process.stderr.readline()
        found = re.match(r"foxglove: (ws://127\.0\.0\.1:\d+/\S+)", line)
        assert found, line
        self.address = found[1]

    def __enter__(self) -> FoxgloveProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        with contextlib.suppress(AttributeError):
            self.process.stderr.close()  # type: ignore[union-attr]


@dataclass
class Viewer:
    """One connection.

    Attributes:
        info, channels: what the server said of itself, and its channels by topic.
        said: its other JSON messages.
        data: log times and payloads by topic.
    """

    socket: ClientConnection
    info: dict[str, Any]
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    said: list[dict[str, Any]] = field(default_factory=list)
    data: dict[str, list[tuple[int, bytes]]] = field(default_factory=dict)

    async def subscribe(self, *topics: str) -> None:
        """Subscriptions have the channel's number and a thousand."""
        entries = [{"id": 1000 + self.channels[t]["id"], "channelId": self.channels[t]["id"]} for t in topics]
        await self.tell(op="subscribe", subscriptions=entries)

    async def tell(self, **message: Any) -> None:
        await self.socket.send(json.dumps(message))

    async def hear(self) -> dict[str, Any] | None:
        """Takes one message. Returns it if it is JSON."""
        message = await asyncio.wait_for(self.socket.recv(), PATIENCE)
        if isinstance(message, str):
            found = json.loads(message)
            if found["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in found["channels"]}
            else:
                self.said.append(found)
            return dict(found)
        opcode, subscription, stamp = DATA.unpack_from(message)
        assert opcode == 1
        (topic,) = (t for t, channel in self.channels.items() if channel["id"] + 1000 == subscription)
        self.data.setdefault(topic, []).append((stamp, message[DATA.size :]))
        return None

    async def until(self, *topics: str, count: int = 1) -> None:
        """Takes messages until each topic has so many."""
        while any(len(self.data.get(topic, ())) < count for topic in topics):
            await self.hear()


@contextlib.asynccontextmanager
async def viewing(address: str, origin: str | None = None, protocol: str = PROTOCOL) -> AsyncIterator[Viewer]:
    """A connection that knows the server's channels."""
    async with connect(address, origin=origin, subprotocols=[protocol], max_size=None) as socket:  # type: ignore[arg-type, list-item]
        info = json.loads(await asyncio.wait_for(socket.recv(), PATIENCE))
        assert info["op"] == "serverInfo"
        viewer = Viewer(socket, info)
        while not viewer.channels:
            await viewer.hear()
        yield viewer
