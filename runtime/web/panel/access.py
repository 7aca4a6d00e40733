"""Who may speak to the page's server: one browser, which had the address with the token first.

The token is good for one exchange against two secrets: an address can be read in a process list or in a browser's
history, and must be worth nothing there. The cookie lets the page be loaded. But a browser shows a cookie to every
server of this host, whatever its port. So whoever listens, commands or stops shows the key: the page keeps it in the
browser's storage, which belongs to one origin, port included. It is in no address. A page of another site is refused
by its Origin, and so is a Host that isn't ours (DNS rebinding).
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Awaitable, Callable
from typing import Final

from aiohttp import web

HOST: Final = "127.0.0.1"
KEY: Final = "X-Srl-Key"  # header with the key
PROTOCOL: Final = "srl"  # of the websocket, which can't have that header: a second protocol offered is the key
SECONDS: Final = 24 * 3600  # s that a browser keeps the cookie, through a crash of its own; the server's end ends it
_SPENT = "This address was used already, or it is wrong. A new one: srl panel --again\n"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Access:
    """The doors of one server on one port."""

    def __init__(self, port: int) -> None:
        self._authority = f"{HOST}:{port}"
        self._origin = f"http://{self._authority}"
        self._cookie = f"srl-panel-{port}"  # a cookie counts for all ports of a host: each server has its own
        self._secret = ""
        self._key = ""
        self._token = ""
        # Called as a browser is let in: with its transport, and whether by the key or token, else the cookie.
        self.entered: Callable[[asyncio.BaseTransport | None, bool], object] = lambda *_: None
        # Called as a browser takes the place of the one before.
        self.replaced: Callable[[], object] = lambda: None

    def address(self) -> str:
        """Returns a new address, good for one browser once; the one before is worth nothing from now on."""
        self._token = secrets.token_urlsafe(24)
        return f"{self._origin}/?token={self._token}"

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answers what isn't allowed, and gives every answer its headers."""
        try:
            answer = await self._checked(request, handler)
        except web.HTTPException as error:
            error.headers.update(self._headers)
            raise
        if not answer.prepared:
            answer.headers.update(self._headers)
        return answer

    async def _checked(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.headers.getall("Host", []) != [self._authority]:
            raise web.HTTPMisdirectedRequest(text="This server has another name.\n")
        origins = request.headers.getall("Origin", [])
        speaks = request.method != "GET" or "Upgrade" in request.headers
        if (origins or speaks) and origins != [self._origin]:
            raise web.HTTPForbidden(text="A page from elsewhere may not speak to this server.\n")
        if request.path == "/" and "token" in request.query:
            return await self._exchange(request, handler)
        # What speaks shows the key alone: a page of another port can overwrite our cookie, and must not stop a stop.
        given, secret = (_key(request), self._key) if speaks else (request.cookies.get(self._cookie, ""), self._secret)
        if not _same(given, secret):
            raise web.HTTPForbidden(text="Open the address that was printed, or a new one: srl panel --again\n")
        self.entered(request.transport, speaks)  # a cookie may be known to another user
        return await handler(request)

    async def _exchange(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answers with the page, which holds the key this once."""
        if not _same(request.query["token"], self._token):
            raise web.HTTPForbidden(text=_SPENT)
        self.entered(request.transport, True)
        self._token, self._secret, self._key = "", secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        self.replaced()
        page = await handler(request)
        assert isinstance(page, web.Response)
        page.text = (page.text or "").replace("<head>", f'<head>\n<meta name="key" content="{self._key}">', 1)
        page.set_cookie(
            self._cookie, self._secret, max_age=SECONDS, path="/", httponly=True, samesite="Strict"
        )  # fmt: skip
        return page

    @property
    def _headers(self) -> dict[str, str]:
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; base-uri 'none'; "
            f"form-action 'none'; frame-ancestors 'none'; connect-src 'self' ws://{self._authority}"
        )
        return {
            "Content-Security-Policy": policy,
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Embedder-Policy": "require-corp",
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
        }


def _key(request: web.Request) -> str:
    """The key that a request shows; "" for none."""
    if "Upgrade" not in request.headers:
        return request.headers.get(KEY, "")
    offered = [name.strip() for name in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
    return offered[1] if len(offered) == 2 and offered[0] == PROTOCOL else ""


def _same(given: str, secret: str) -> bool:
    """Whether a secret is there, and is the given one."""
    return bool(secret) and hmac.compare_digest(given.encode(errors="backslashreplace"), secret.encode())
