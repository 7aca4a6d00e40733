"""The server of `--foxglove`: a run's topics over Foxglove's websocket protocol, on 127.0.0.1, for who has the key.

foxglove-sdk has a server of its own, which lets in whoever reaches its port, a page of any site included: so this one
stands behind the door of the pages.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

from aiohttp import web

from srl.runtime.ipc.rows import Condition
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.foxglove.access import KeyAccess
from srl.runtime.web.foxglove.client import AGAIN, PROTOCOLS, Client
from srl.runtime.web.foxglove.feed import Feed
from srl.runtime.web.panel.pages import PEERS, POLL, behind_door, listen

CLOSING: Final = 2.0  # s that the clients get for the run's last picture


class FoxgloveServer:
    """Serves one run.

    Attributes:
        address: what is pasted into the app.
        condition: how the run is.
    """

    def __init__(self, run: RunFolder) -> None:
        """Raises RecordingError: there is no run here."""
        self._run, self._feed = run, Feed(run)
        self._clients: list[Client] = []
        self._words, self._generation = "", self._feed.generation
        self.condition, self.address = Condition.SILENT, ""

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[asyncio.Task[None]]:
        """Serves meanwhile, on any free port, and gives the task that follows the loop. Raises HostError: no port."""
        listener = listen(0)
        access = KeyAccess(listener.getsockname()[1])
        self.address = access.address
        app = web.Application(middlewares=[access.middleware], client_max_size=1024)
        app.router.add_get("/{key}", self._talk, allow_head=False)
        async with behind_door(listener, app, self._run) as door:
            access.entered = door.let_in
            follower = asyncio.create_task(self._follow(door.look))
            try:
                yield follower
            finally:
                follower.cancel()
                for client in list(self._clients):
                    with contextlib.suppress(TimeoutError, ConnectionError):
                        await asyncio.wait_for(client.socket.close(code=1001, message=b"the run is over"), CLOSING)
                self._feed.close()

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        offered = [name.strip() for name in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        if not set(offered) & set(PROTOCOLS):
            raise web.HTTPBadRequest(text=f"This speaks {' and '.join(PROTOCOLS)}.\n")
        if len(self._clients) >= PEERS:
            raise web.HTTPServiceUnavailable(text="Too many viewers are open.\n")
        client = Client()
        await client.socket.prepare(request)
        client.greet(self._feed)
        if self._words:
            client.status(self._words)
        self._clients.append(client)
        sender = asyncio.create_task(client.send())
        try:
            while await client.hear():
                pass
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender
            self._clients.remove(client)
        return client.socket

    async def _follow(self, look_at_door: Callable[[float], object]) -> None:
        while True:
            now = time.monotonic()
            fresh = self._feed.look(now)
            if self._feed.generation != self._generation:  # other topics: whoever looks comes anew
                self._generation = self._feed.generation
                for client in list(self._clients):
                    asyncio.create_task(client.socket.close(code=AGAIN, message=b"another run"))  # noqa: RUF006
            self.condition, words = self._feed.condition(now)
            if words != self._words:
                self._words = words
                for client in self._clients:
                    client.status(words)
            for client in self._clients if fresh else ():
                client.wake()
            look_at_door(now)
            await asyncio.sleep(POLL)
