"""Speaks to a server of pages as its page does, or as somebody who isn't."""

from __future__ import annotations

import asyncio
import http.client
from collections.abc import Awaitable, Callable
from typing import Any, Protocol
from urllib.parse import urlsplit

import aiohttp

from helpers.panel import shown

Socket = aiohttp.ClientWebSocketResponse
UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}  # fmt: skip


class Served(Protocol):
    """What serves a page."""

    @property
    def address(self) -> str: ...


def place(page: Served) -> str:
    return urlsplit(page.address).netloc


def get(page: Served, path: str, method: str = "GET", **headers: str) -> http.client.HTTPResponse:
    return asked(page, path, method, **headers)[0]


def asked(page: Served, path: str, method: str, **headers: str) -> tuple[http.client.HTTPResponse, str]:
    """An answer, and what it holds."""
    connection = http.client.HTTPConnection(place(page), timeout=20)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in ({"Host": place(page)} | headers).items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    words = answer.read().decode() if answer.status != 101 else ""
    connection.close()
    return answer, words


def cookie(page: Served) -> dict[str, str]:
    """What the browser that took the address shows from then on: the cookie, and its page's key."""
    answer, words = asked(page, f"/?{urlsplit(page.address).query}", "GET")
    assert answer.status == 200
    return {"Cookie": str(answer.headers["Set-Cookie"]).partition(";")[0]} | shown(words)


def talk(page: Served, *parts: Callable[..., Awaitable[Any]], kept: dict[str, str] | None = None) -> Any:
    """Opens as many tabs as the function takes, and hands them to it."""
    (what,) = parts
    headers = {**(kept or cookie(page)), "Origin": f"http://{place(page)}"}
    count = what.__code__.co_argcount  # type: ignore[attr-defined]

    async def run() -> Any:
        async with aiohttp.ClientSession(headers=headers) as session:
            tabs = [await session.ws_connect(f"ws://{place(page)}/socket") for _ in range(count)]
            alive = asyncio.create_task(_live(tabs))
            try:
                return await what(*tabs)
            finally:
                alive.cancel()
                for tab in tabs:
                    await tab.close()

    return asyncio.run(asyncio.wait_for(run(), 60))


async def _live(tabs: list[Socket]) -> None:
    """Each says that it is there, as a page does."""
    while True:
        await asyncio.sleep(0.5)
        for tab in tabs:
            if not tab.closed:
                await tab.send_json({"kind": "ping", "at": 0})


async def heard(tab: Socket, kind: str, **content: object) -> dict[str, Any]:
    """The next message of a kind with this content."""
    while True:
        message: dict[str, Any] = await tab.receive_json()
        if message["kind"] == kind and content.items() <= message.items():
            return message


async def take(tab: Socket) -> None:
    await tab.send_json({"kind": "control", "take": True})
    await heard(tab, "control", yours=True)


async def ponged(tab: Socket) -> None:
    """What was said before is handled."""
    await tab.send_json({"kind": "ping", "at": 1})
    await heard(tab, "pong", at=1)


async def closed(tab: Socket) -> int | None:
    while not tab.closed:
        await tab.receive()
    return tab.close_code
