"""The page's server: files, a websocket and the stop, on 127.0.0.1. It reads the loop's rows and never waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from runtime.contracts.errors import HostError
from runtime.ipc.control_socket import send_request
from runtime.ipc.run_folder import RunFolder
from runtime.panel.access import HOST, Access
from runtime.panel.peer import BadMessageError, Peer, frame_rows, number
from runtime.panel.session import Session
from runtime.panel.source import Reading, Source

PAGE: Final = Path(__file__).parent / "page"
FILES: Final = {  # all there is to fetch
    "/": ("index.html", "text/html"),
    "/screen.js": ("screen.js", "text/javascript"),
    "/drawing.js": ("drawing.js", "text/javascript"),
    "/screen.css": ("screen.css", "text/css"),
}
POLL: Final = 0.004  # s between looks for new rows
KEEP: Final = 0.05  # s after which the page is told again, though there is no new row
PEERS: Final = 8  # pages at once


class Server:
    """Serves one instance's screen; see the module's docstring."""

    def __init__(self, run_folder: RunFolder, source: Source) -> None:
        self.session = Session()
        self._folder, self._source = run_folder, source
        self._peers: list[Peer] = []
        self._access: Access | None = None
        self.session.changed = self._tell

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
        for path in FILES:
            app.router.add_get(path, self._file, allow_head=False)
        app.router.add_get("/socket", self._talk, allow_head=False)
        app.router.add_post("/stop", self._stop)
        runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=1.0)
        await runner.setup()
        await web.SockSite(runner, listener).start()
        follower = asyncio.create_task(self._follow())
        try:
            yield follower
        finally:
            follower.cancel()
            for peer in list(self._peers):
                await peer.socket.close(code=1001, message=b"the server ends")
            await runner.cleanup()
            self._source.close()

    async def _file(self, request: web.Request) -> web.Response:
        name, kind = FILES[request.path]
        return web.Response(body=(PAGE / name).read_bytes(), content_type=kind, charset="utf-8")

    async def _stop(self, request: web.Request) -> web.Response:
        """A stop by the participant. It goes straight to the loop's stop socket, whatever the state of the screen."""
        sent = asyncio.get_running_loop().run_in_executor(None, send_request, self._folder, "stop")
        self.session.abort("stopped on the screen", time.monotonic())
        answer = await sent
        return web.json_response(answer or {"ok": False, "error": "no answer"}, status=200 if answer else 504)

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        if len(self._peers) >= PEERS:
            raise web.HTTPServiceUnavailable(text="Too many pages are open.\n")
        peer = Peer()
        await peer.socket.prepare(request)
        peer.participant = not any(p.participant for p in self._peers)
        self._peers.append(peer)
        peer.tell({"kind": "hello", "participant": peer.participant})
        peer.tell({"kind": "state", **self.session.state()})
        sender = asyncio.create_task(peer.send())
        try:
            while (message := await peer.hear()) is not None:
                try:
                    self._heard(peer, message)
                except BadMessageError as error:
                    await peer.refuse(str(error))
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender
            self._peers.remove(peer)
            if peer.participant and self.session.began:
                self.session.abort("the page was closed", time.monotonic())
        return peer.socket

    def _heard(self, peer: Peer, message: dict[str, Any]) -> None:
        """Raises BadMessageError."""
        now = time.monotonic()
        match message.get("kind"):
            case "ping":
                peer.tell({"kind": "pong", "at": number(message, "at"), "now": now * 1e3})
            case "begin":
                if peer.participant and (why := self.session.begin(now)):
                    peer.tell({"kind": "notice", "words": why})
            case "frames":
                rows = frame_rows(message)
                trip = number(message, "round_trip") / 1e3
                if peer.participant and (why := self.session.frames(rows, message.get("final") is True, trip)):
                    raise BadMessageError(why)
            case "hidden":
                if peer.participant and self.session.began:
                    self.session.abort("the page was hidden", now)
            case _:
                raise BadMessageError("unknown kind")

    def _tell(self) -> None:
        for peer in self._peers:
            peer.tell({"kind": "state", **self.session.state()})

    async def _follow(self) -> None:
        """Takes the loop's rows and shows the newest value."""
        shown, due = (0.0, ""), 0.0
        while True:
            now = time.monotonic()
            rows, reading = self._source.take(now)
            self.session.tick(rows, reading, self._source.lost, now)
            if (reading.stamp, reading.words) != shown or now >= due:
                shown, due = (reading.stamp, reading.words), now + KEEP
                text = _value(reading)
                for peer in self._peers:
                    peer.show(text)
            await asyncio.sleep(POLL)


def _value(reading: Reading) -> str:
    value = reading.value if math.isfinite(reading.value) else None
    message = {"kind": "value", "t": reading.stamp * 1e3, "y": value}
    return json.dumps(message | {"condition": reading.condition, "words": reading.words})


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
        raise HostError(f"{HOST}:{port}", problem, "Give another --port, or none") from None
    return made
