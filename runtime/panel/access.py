"""Who may speak to the page's server: one browser, which had the address with the token first.

The token is good for one exchange against a cookie: an address can be read in a process list or in a browser's
history, and must be worth nothing there. A page of another site can't use the cookie: its Origin is refused, and so is
a Host that isn't ours (DNS rebinding).
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable
from typing import Final

from aiohttp import web

HOST: Final = "127.0.0.1"
SECONDS: Final = 24 * 3600  # s that a browser keeps the cookie, through a crash of its own; the server's end ends it
_SPENT = "This address was used already, or it is wrong. Ask for a new one.\n"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Access:
    """The doors of one server on one port."""

    def __init__(self, port: int) -> None:
        self._authority = f"{HOST}:{port}"
        self._origin = f"http://{self._authority}"
        self._cookie = f"srl-panel-{port}"  # a cookie counts for all ports of a host: each server has its own
        self._secret = ""
        self._token = ""

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
            return self._exchange(request.query["token"])
        given = request.cookies.get(self._cookie, "")
        if not self._secret or not hmac.compare_digest(given.encode(), self._secret.encode()):
            raise web.HTTPForbidden(text="Open the address that `srl panel` printed.\n")
        return await handler(request)

    def _exchange(self, token: str) -> web.StreamResponse:
        if not self._token or not hmac.compare_digest(token.encode(), self._token.encode()):
            raise web.HTTPForbidden(text=_SPENT)
        self._token, self._secret = "", secrets.token_urlsafe(24)
        answer = web.Response(status=303, headers={"Location": "/"})
        answer.set_cookie(
            self._cookie, self._secret, max_age=SECONDS, path="/", httponly=True, samesite="Strict"
        )  # fmt: skip
        return answer

    @property
    def _headers(self) -> dict[str, str]:
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; base-uri 'none'; form-action 'none'; "
            f"frame-ancestors 'none'; connect-src 'self' ws://{self._authority}"
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
