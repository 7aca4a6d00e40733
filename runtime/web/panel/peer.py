"""One page at the other end of a websocket: what it says is checked, what it is told never waits for another page."""

from __future__ import annotations

import asyncio
import json
import math
from typing import Any, Final

from aiohttp import WSMsgType, web

from srl.runtime.web.panel.access import PROTOCOL

LONGEST: Final = 65536  # bytes of a message from a page
PENDING: Final = 64  # messages that a page may be behind; then it is let go
HEARTBEAT: Final = 5.0  # s; a page that is silent for half as long again is gone
_BAD = 1008  # close code: against the rules


class BadMessageError(Exception):
    """A page said something that it can't have meant."""


class Peer:
    """A page's connection.

    Attributes:
        participant: whether this page begins trials; another only looks on.
    """

    def __init__(self) -> None:
        self.socket = web.WebSocketResponse(
            max_msg_size=LONGEST, heartbeat=HEARTBEAT, compress=False, protocols=(PROTOCOL,)
        )
        self.participant = False
        self._waiting: list[str] = []
        self._value = ""
        self._news = asyncio.Event()

    def tell(self, message: dict[str, Any]) -> None:
        """Sends a message, in order and none left out."""
        self._waiting.append(json.dumps(message))
        self._news.set()

    def show(self, value: str) -> None:
        """Sends the newest value, as JSON; one that hasn't left yet is replaced by it."""
        self._value = value
        self._news.set()

    async def send(self) -> None:
        """Sends what there is, until the connection ends."""
        while not self.socket.closed:
            await self._news.wait()
            self._news.clear()
            if len(self._waiting) > PENDING:
                await self.socket.close(code=_BAD, message=b"the page is too slow")
                return
            texts, self._waiting = self._waiting, []
            value, self._value = self._value, ""
            for text in [*texts, value] if value else texts:
                await self.socket.send_str(text)

    async def hear(self) -> dict[str, Any] | None:
        """Waits for the page's next message. None: the connection has ended, maybe for a message that was no JSON."""
        message = await self.socket.receive()
        if message.type is not WSMsgType.TEXT:
            if message.type is WSMsgType.BINARY:
                await self.refuse("not a text")
            return None
        try:
            content = json.loads(message.data)
            if not isinstance(content, dict):
                raise BadMessageError
        except (ValueError, RecursionError, BadMessageError):
            await self.refuse("not a JSON object")
            return None
        return content

    async def refuse(self, why: str) -> None:
        """Ends the connection, and says why."""
        await self.socket.close(code=_BAD, message=why.encode())


def number(content: dict[str, Any], key: str) -> float:
    """A finite number of a message. Raises BadMessageError."""
    value = content.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e15:
        raise BadMessageError(f"'{key}' must be a number")
    return float(value)


def frame_rows(content: dict[str, Any]) -> list[list[float]]:
    """The page's frames: ms, value or null, age in ms or null, as s; null becomes NaN. Raises BadMessageError."""
    rows = content.get("rows")
    if not isinstance(rows, list):
        raise BadMessageError("'rows' must be a list")
    found = []
    for row in rows:
        if not isinstance(row, list) or len(row) != 3:
            raise BadMessageError("a frame has three numbers")
        t, value, age = (
            math.nan if x is None and i else number({"frame": x}, "frame") for i, x in enumerate(row)
        )  # fmt: skip
        found.append([t / 1e3, value, age / 1e3])
    return found
