"""A headless Chromium, driven over its DevTools protocol: enough to open a page, press a key and ask what it shows."""

from __future__ import annotations

import asyncio
import base64
import os
import shutil
import signal
import subprocess
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from helpers.wait import until

NAMES = ("chromium", "chromium-browser", "google-chrome")
TIMEOUT = 30.0  # s for one answer


NO_WEBGL = """const context = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind.startsWith("webgl") ? null : context.call(this, kind, ...rest);
    };"""  # as a browser that has none


def found() -> str:
    """The browser's path. The test is skipped where there is none."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    pytest.skip("Chromium is not installed: apt install chromium")


class Chromium:
    """One browser with a profile of its own; a context manager that leaves no process."""

    def __init__(self, folder: Path) -> None:
        self._loop = asyncio.new_event_loop()
        flags = ["--headless=new", "--remote-debugging-port=0", f"--user-data-dir={folder}", "--no-first-run"]
        flags += ["--disable-gpu", "--hide-scrollbars", "--window-size=1600,900", "--disable-dev-shm-usage"]
        flags += ["--disable-background-networking", "--disable-component-update", "--no-default-browser-check"]
        flags += ["--no-sandbox"] if os.geteuid() == 0 else []  # its sandbox refuses root
        self._process = subprocess.Popen(
            [found(), *flags, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        port = folder / "DevToolsActivePort"
        try:
            until(lambda: port.exists() and port.read_text().count("\n"), self._lives, what="Chromium", pause=0.02)
            self._session = self._wait(self._client())
            self._port = int(port.read_text().split()[0])
        except BaseException:
            self._end()
            raise

    def __enter__(self) -> Chromium:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._wait(self._session.close())
        finally:
            self._end()

    def open(self, url: str, before: str = "") -> Page:
        """Opens a page in a tab of its own. `before`: a script that runs before the page's own."""
        page = Page(self._wait(self._connect()), self._wait)
        if before:
            page.ask("Page.enable")
            page.ask("Page.addScriptToEvaluateOnNewDocument", source=before)
        return page.go(url)

    def _lives(self) -> None:
        assert self._process.poll() is None, "Chromium has ended"

    def _end(self) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._loop.close()

    def _wait(self, what: Any) -> Any:
        return self._loop.run_until_complete(asyncio.wait_for(what, TIMEOUT))

    async def _client(self) -> aiohttp.ClientSession:
        return aiohttp.ClientSession()

    async def _connect(self) -> aiohttp.ClientWebSocketResponse:
        made = await self._session.put(f"http://127.0.0.1:{self._port}/json/new?about:blank")
        content = await made.json(content_type=None)
        return await self._session.ws_connect(content["webSocketDebuggerUrl"], max_msg_size=0)


class Page:
    """One tab."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse, wait: Any) -> None:
        self._socket, self._wait = socket, wait
        self._number = 0

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the DevTools protocol and its result."""
        found: dict[str, Any] = self._wait(self._ask(method, parameters))
        return found

    async def _ask(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._number += 1
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        while True:
            answer = await self._socket.receive_json()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def go(self, url: str) -> Page:
        """Goes to an address, and waits until it is there."""
        self.ask("Page.enable")
        self.ask("Page.navigate", url=url)
        until(lambda: self.value("document.readyState") == "complete" and self.value("location.href") != "about:blank")
        return self

    def reload(self) -> None:
        """Loads the page again."""
        self.value("globalThis.before = true")
        self.ask("Page.reload")
        until(lambda: self.value("!globalThis.before && document.readyState == 'complete'"))

    def value(self, expression: str) -> Any:
        """What an expression, or the promise that it gives, comes to; None where the page isn't there yet."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return answer["result"].get("value")

    def key(self, key: str, code: str, number: int) -> None:
        """Presses a key."""
        for kind in ("rawKeyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=number)

    def picture(self, path: Path) -> None:
        """Saves what the page shows as PNG."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        """Closes the tab."""
        self.ask("Page.close")
        self._wait(self._socket.close())
