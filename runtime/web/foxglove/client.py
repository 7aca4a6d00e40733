"""One connection of Foxglove's app: what it subscribes to, and what it is sent.

It speaks Foxglove's websocket protocol, of which only what shows topics is there: serverInfo, advertise, subscribe,
unsubscribe, status and message data. Source: https://github.com/foxglove/ws-protocol, docs/spec.md; foxglove-sdk,
rust/foxglove/src/protocol.

A connection that is slow gets fewer pictures, and always the newest: nothing old waits for it.
"""

from __future__ import annotations

import asyncio
import json
import struct
from typing import Any, Final

from aiohttp import WSMsgType, web

from srl.runtime.web.foxglove.feed import Feed
from srl.runtime.web.panel.peer import LONGEST

PROTOCOLS: Final = ("foxglove.sdk.v1", "foxglove.websocket.v1")  # the same in what is spoken here
HEARTBEAT: Final = 20.0  # s; who is silent for half as long again is gone
SUBSCRIPTIONS: Final = 4096  # of one connection, at most
WAITING: Final = 256  # answers that a connection may be behind; then it is let go
WARNING: Final = 1  # level of a status
BAD, AGAIN = 1008, 1012  # close codes: against the rules; come again, for another run
_DATA = struct.Struct("<BIQ")  # opcode, subscription, log time in ns


class Client:
    """One connection."""

    def __init__(self) -> None:
        self.socket = web.WebSocketResponse(
            max_msg_size=LONGEST, heartbeat=HEARTBEAT, compress=False, protocols=PROTOCOLS
        )
        self.feed: Feed | None = None
        self._channels: dict[int, int] = {}  # by subscription
        self._waiting: list[str | bytes] = []
        self._news = asyncio.Event()
        self._generation = 0
        self._shown = 0  # the newest picture that was sent
        self._events: dict[int, int] = {}  # by subscription: the number of the next event

    def greet(self, feed: Feed) -> None:
        """Says which topics there are."""
        self.feed, self._generation = feed, feed.generation
        about = {"name": f"srl {feed.name}", "capabilities": [], "metadata": {}, "sessionId": feed.session}
        self._tell({"op": "serverInfo", **about})
        self._tell({"op": "advertise", "channels": feed.channels})

    def status(self, words: str) -> None:
        """Says how the run is; "": well."""
        if words:
            self._tell({"op": "status", "level": WARNING, "message": words, "id": "run"})
        else:
            self._tell({"op": "removeStatus", "statusIds": ["run"]})

    def wake(self) -> None:
        """There is a new picture, or an event."""
        self._news.set()

    async def send(self) -> None:
        """Sends what there is, until the connection ends."""
        while not self.socket.closed:
            await self._news.wait()
            self._news.clear()
            if len(self._waiting) > WAITING:
                await self.socket.close(code=BAD, message=b"too slow")
                return
            waiting, self._waiting = self._waiting, []
            for message in waiting:
                if isinstance(message, str):
                    await self.socket.send_str(message)
                else:
                    await self.socket.send_bytes(message)
            await self._send_picture()

    async def _send_picture(self) -> None:
        feed = self.feed
        if feed is None or feed.generation != self._generation:  # it is about to be let go
            return
        for subscription, number in list(self._events.items()):
            fresh, self._events[subscription] = feed.events_since(number)
            for at, event in fresh:
                await self.socket.send_bytes(_DATA.pack(1, subscription, at) + event)
        if feed.number == self._shown:
            return
        # One picture: the payloads are of one row, however long the connection takes for them.
        self._shown, stamp, picture = feed.number, feed.stamp, feed.picture
        for subscription, channel in list(self._channels.items()):
            if (payload := picture(channel)) is not None:
                await self.socket.send_bytes(_DATA.pack(1, subscription, stamp) + payload)

    async def hear(self) -> bool:
        """Takes the next message. Returns whether the connection goes on."""
        message = await self.socket.receive()
        if message.type is WSMsgType.BINARY:  # a client's own messages, which nobody takes here
            await self.socket.close(code=BAD, message=b"nothing is taken here")
            return False
        if message.type is not WSMsgType.TEXT:
            return False
        try:
            self._heard(json.loads(message.data))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            await self.socket.close(code=BAD, message=b"not a message of the protocol")
            return False
        return True

    def _heard(self, message: dict[str, Any]) -> None:
        feed = self.feed
        assert feed is not None
        match message["op"]:
            case "subscribe":
                for entry in message["subscriptions"]:
                    subscription, channel = int(entry["id"]), int(entry["channelId"])
                    if not 0 <= channel < len(feed.channels) or not 0 <= subscription < 1 << 32:
                        raise ValueError(entry)
                    if len(self._channels) + len(self._events) >= SUBSCRIPTIONS:
                        raise ValueError(SUBSCRIPTIONS)
                    self._subscribe(feed, subscription, channel)
            case "unsubscribe":
                for subscription in message["subscriptionIds"]:
                    self._channels.pop(int(subscription), None)
                    self._events.pop(int(subscription), None)
            case other:
                self._tell(
                    {"op": "status", "level": WARNING, "message": f"'{other}' isn't possible: one can only look"}
                )

    def _subscribe(self, feed: Feed, subscription: int, channel: int) -> None:
        if (kept := feed.kept(channel)) is not None:
            self._waiting.append(_DATA.pack(1, subscription, feed.stamp or feed.first) + kept)
        elif feed.is_events(channel):
            self._events[subscription] = 0
        else:
            self._channels[subscription] = channel
            self._shown = 0  # it gets the newest picture at once
        self.wake()

    def _tell(self, message: dict[str, Any]) -> None:
        self._waiting.append(json.dumps(message))
        self.wake()
