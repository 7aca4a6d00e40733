"""Who may follow a run with Foxglove's app: who has the address, which holds a key.

The app opens a websocket at an address that a person types or pastes into it. It can show neither a cookie nor a header
of ours, and connects again by itself, so the key is good as long as the server runs. It is in no page's address: a page
never sees it, and nothing but a websocket is served. With it one can look, and command nothing. A page of another site
is refused by its Origin, too, and so is a Host that isn't ours (DNS rebinding).
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Awaitable, Callable
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web

from srl.runtime.web.panel.access import HOST

APP: Final = "https://app.foxglove.dev"
FILES: Final = "file://"  # what a viewer's desktop program sends, whose page is a file
HERE: Final = (HOST, "localhost")  # a viewer that this machine serves

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class KeyAccess:
    """The door of one server on one port.

    Attributes:
        address: what is pasted into the app.
    """

    def __init__(self, port: int) -> None:
        self._hosts = [f"{host}:{port}" for host in HERE]
        self._key = secrets.token_urlsafe(24)
        self.address = f"ws://{self._hosts[0]}/{self._key}"
        # Called as a program is let in: with its transport, and that it had the key.
        self.entered: Callable[[asyncio.BaseTransport | None, bool], object] = lambda *_: None

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answers what isn't allowed."""
        hosts, origins = request.headers.getall("Host", []), request.headers.getall("Origin", [])
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise web.HTTPMisdirectedRequest(text="This server has another name.\n")
        if len(origins) > 1 or not all(map(_is_viewer, origins)):
            raise web.HTTPForbidden(text="A page from elsewhere may not speak to this server.\n")
        given = request.path[1:].encode(errors="backslashreplace")
        if not hmac.compare_digest(given, self._key.encode()):
            raise web.HTTPForbidden(text="Open the address that was printed.\n")
        self.entered(request.transport, True)
        return await handler(request)


def _is_viewer(origin: str) -> bool:
    """Whether a page of this origin may be the app."""
    if origin in (APP, FILES):
        return True
    try:
        return urlsplit(origin).scheme in ("http", "https") and urlsplit(origin).hostname in HERE
    except ValueError:
        return False
