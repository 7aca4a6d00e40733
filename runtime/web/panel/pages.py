"""A server of pages on 127.0.0.1: files, a websocket and the stop. It reads the loop's rows and never waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, ClassVar, Final

from aiohttp import web

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.control_socket import send_note, send_request
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel import again
from srl.runtime.web.panel.access import HOST, Access
from srl.runtime.web.panel.door import Door
from srl.runtime.web.panel.peer import BadMessageError, Peer, number

PAGE: Final = Path(__file__).parent / "page"
POLL: Final = 0.004  # s between looks for new rows
KEEP: Final = 0.05  # s after which the page is told again, though there is no new row
PEERS: Final = 8  # pages at once


class PageServer(ABC):
    """Serves one kind of page of one instance.

    Attributes:
        files: all files there are to fetch: name and kind, by path.
        called: the page's name, for people.
        peers: the pages that are open, the oldest first.
    """

    files: ClassVar[Mapping[str, tuple[str, str]]]
    called: ClassVar[str] = "the page"

    def __init__(self, run_folder: RunFolder) -> None:
        self.peers: list[Peer] = []
        self._folder = run_folder
        self._access: Access | None = None
        self._door: Door | None = None
        self._stops = ThreadPoolExecutor(4, thread_name_prefix="stop")  # nobody else's work keeps a stop waiting
        self._stopping: set[asyncio.Task[None]] = set()

    @abstractmethod
    def joined(self, peer: Peer) -> None:
        """A page is there; it isn't among the peers yet."""

    def heard(self, peer: Peer, message: dict[str, Any]) -> None:
        """A page said something: what every page says; each kind of page adds its own. Raises BadMessageError."""
        if message.get("kind") != "ping":
            raise BadMessageError("unknown kind")
        peer.tell({"kind": "pong", "at": number(message, "at"), "now": time.monotonic() * 1e3})

    def left(self, peer: Peer) -> None:
        """A page is gone."""

    def stopped(self) -> None:
        """A stop was asked for on a page; it is on its way."""

    @abstractmethod
    def look(self) -> None:
        """Takes new rows and shows them to the peers. It is called each POLL."""

    @abstractmethod
    def close(self) -> None:
        """Unmaps the rows."""

    def address(self) -> str:
        """Returns a new address for one browser."""
        assert self._access is not None
        return self._access.address()

    @asynccontextmanager
    async def serving(self, port: int = 0) -> AsyncIterator[asyncio.Task[None]]:
        """Serves meanwhile, and gives the task that follows the loop. Raises HostError: the port can't be had.

        Args:
            port: 0: any free one.
        """
        listener = listen(port)
        self._access = Access(listener.getsockname()[1])
        app = web.Application(middlewares=[self._access.middleware], client_max_size=1024)
        for path in self.files:
            app.router.add_get(path, self._file, allow_head=False)
        app.router.add_get("/socket", self._talk, allow_head=False)
        app.router.add_post("/stop", self._stop)
        try:
            async with (
                behind_door(listener, app, self._folder) as door,
                again.answering(self._folder, self.called, self.address),
            ):
                self._door = door
                self._access.entered, self._access.replaced = door.let_in, self._close_pages
                follower = asyncio.create_task(self._follow())
                try:
                    yield follower
                finally:
                    follower.cancel()
                    for peer in list(self.peers):
                        await peer.socket.close(code=1001, message=b"the server ends")
        finally:
            self._stops.shutdown(wait=False)
            self.close()

    def _close_pages(self) -> None:
        """Another browser has the page from now on: those that are open have nothing to say any more."""
        for peer in self.peers:
            task = asyncio.create_task(_close(peer))
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)

    async def _file(self, request: web.Request) -> web.Response:
        name, kind = self.files[request.path]
        return web.Response(body=(PAGE / name).read_bytes(), content_type=kind, charset="utf-8")

    async def _stop(self, request: web.Request) -> web.Response:
        """A stop by a person. It goes straight to the loop's stop socket, whatever the state of the page."""
        answer = await self._ask_stop()
        return web.json_response(answer or {"ok": False, "error": "no answer"}, status=200 if answer else 504)

    async def _ask_stop(self) -> dict[str, object] | None:
        sent = asyncio.get_running_loop().run_in_executor(self._stops, send_request, self._folder, "stop")
        self.stopped()
        return await sent

    def _stop_for(self, peer: Peer, message: dict[str, Any]) -> None:
        """A stop over the page's open connection."""

        async def send() -> None:
            answer = await self._ask_stop()
            peer.tell({"kind": "stopped", "at": message.get("at"), "ok": bool(answer and answer["ok"])})

        task = asyncio.create_task(send())
        self._stopping.add(task)
        task.add_done_callback(self._stopping.discard)

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        if len(self.peers) >= PEERS:
            raise web.HTTPServiceUnavailable(text="Too many pages are open.\n")
        peer = Peer()
        await peer.socket.prepare(request)
        self.joined(peer)
        self.peers.append(peer)
        sender = asyncio.create_task(peer.send())
        try:
            while (message := await peer.hear()) is not None:
                try:
                    if message.get("kind") == "stop":
                        self._stop_for(peer, message)
                    else:
                        self.heard(peer, message)
                except BadMessageError as error:
                    await peer.refuse(str(error))
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender
            self.peers.remove(peer)
            self.left(peer)
        return peer.socket

    async def _follow(self) -> None:
        while True:
            self.look()
            if self._door is not None:
                self._door.look(time.monotonic())
            await asyncio.sleep(POLL)


async def _close(peer: Peer) -> None:
    with contextlib.suppress(ConnectionError):
        await peer.socket.close(code=1008, message=b"another browser has the page")


@asynccontextmanager
async def behind_door(listener: socket.socket, app: web.Application, run: RunFolder) -> AsyncIterator[Door]:
    """Serves an application meanwhile, through a door that says in the run's events when it is being filled."""
    runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=1.0, keepalive_timeout=15.0)
    await runner.setup()
    assert runner.server is not None
    door = Door(listener, runner.server, lambda text: send_note(run, text))
    try:
        yield door
    finally:
        door.close()
        await runner.cleanup()


def listen(port: int) -> socket.socket:
    """A listening socket on 127.0.0.1. Raises HostError: the port can't be had."""
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((HOST, port))
        made.listen(16)
    except OSError as error:
        made.close()
        problem = f"the page can't be served here: {error.strerror}"
        raise HostError(f"{HOST}:{port}", problem, "Give another --web-port, or none") from None
    return made
