"""The server of `--view`: rerun's viewer, fed over the page's own websocket, behind the doors of `web.panel`.

A page that draws slowly must not show the past as if it were now. So it gets one part of the stream after another, each
when it has drawn the one before: nothing old waits in the browser. It is told how the run is, and says itself how old
the picture is (`viewer.js`).
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import TYPE_CHECKING, Any, ClassVar, Final

from aiohttp import web

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.rows import Condition, Rows
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.pages import KEEP, PageServer
from srl.runtime.web.panel.peer import Peer
from srl.runtime.web.viewing.assets import Assets, extract
from srl.runtime.web.viewing.mark import Mark

if TYPE_CHECKING:  # it imports rerun, which takes long
    from srl.runtime.web.viewing.feed import Feed

HEARTBEAT: Final = 60.0  # s: without a graphics card the viewer may draw for long, and begins anew if it is let go
LAST: Final = 2.0  # s that the pages get for the run's last rows
_UNPACED: Final = "Simulated as fast as the machine goes: no time here is of now"


class Watcher(Peer):
    """A page with the viewer."""

    def __init__(self) -> None:
        super().__init__(HEARTBEAT)
        self.feed: Feed | None = None
        self.mark = Mark()
        self.draws = False  # it has something that it has not drawn yet

    async def send_more(self) -> None:
        if self.feed is None or self.draws:
            return
        mark, newest, data = await asyncio.to_thread(self.feed.since, self.mark)
        if data:
            self.draws = True
            self.mark = mark
            await self.socket.send_str(json.dumps({"kind": "part", "newest": newest}))
            await self.socket.send_bytes(data)  # waits for a page that doesn't read


class ViewerServer(PageServer):
    """Serves one run's viewer, which is taken out of rerun's binary when it is asked for first.

    Attributes:
        feed: what is shown, once it is there.
    """

    called: ClassVar = "rerun's viewer"
    scripts: ClassVar = "'self' 'wasm-unsafe-eval'"
    files: ClassVar = {
        "/": ("viewer.html", "text/html"),
        "/viewer.js": ("viewer.js", "text/javascript"),
        "/age.js": ("age.js", "text/javascript"),
        "/link.js": ("link.js", "text/javascript"),
        "/part.js": ("part.js", "text/javascript"),
        "/viewer.css": ("viewer.css", "text/css"),
    }

    def __init__(self, run_folder: RunFolder) -> None:
        """Raises RecordingError: there is no run here."""
        super().__init__(run_folder)
        self.feed: Feed | None = None
        self._rows, self._due = Rows(run_folder), 0.0
        self._newest = Mark()
        self._assets: asyncio.Future[Assets] | None = None

    def add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/re_viewer.js", self._script, allow_head=False)
        router.add_get("/re_viewer_bg.wasm", self._wasm, allow_head=False)

    def peer(self) -> Peer:
        return Watcher()

    def joined(self, peer: Peer) -> None:
        assert isinstance(peer, Watcher)
        meta = self._rows.layout.meta
        wall = None if meta.get("unpaced") else int(meta.get("wall", 0)) / 1e6
        peer.tell({"kind": "run", "name": str(meta.get("name", "srl")), "wall": wall})
        peer.feed = self.feed
        peer.wake()

    def heard(self, peer: Peer, message: dict[str, Any]) -> None:
        assert isinstance(peer, Watcher)
        if message.get("kind") == "drawn":
            peer.draws = False
            peer.wake()
        else:
            super().heard(peer, message)

    def look(self) -> None:
        if (now := time.monotonic()) < self._due:
            return
        self._due = now + KEEP
        self._rows.take(now)
        condition, words = self._rows.condition(now)
        if self._rows.layout.meta.get("unpaced") and condition is not Condition.ENDED:
            condition, words = Condition.HELD, _UNPACED
        text = json.dumps({"kind": "now", "condition": condition, "words": words})
        fresh = self.feed is not None and self.feed.mark != self._newest
        self._newest = self.feed.mark if self.feed is not None else Mark()
        for peer in self.peers:
            assert isinstance(peer, Watcher)
            peer.feed = self.feed
            peer.show(text)
            if fresh:
                peer.wake()

    async def last(self) -> None:
        """Waits, a while at most, until the pages have what there is."""
        self._due = 0.0
        self.look()
        end = time.monotonic() + LAST
        while time.monotonic() < end and not all(self._has_all(peer) for peer in self.peers):
            await asyncio.sleep(0.02)

    def _has_all(self, peer: Peer) -> bool:
        assert isinstance(peer, Watcher)
        return not peer.pending and not peer.draws and (self.feed is None or peer.mark == self.feed.mark)

    def close(self) -> None:
        self._rows.close()
        if self.feed is not None:
            self.feed.close()

    async def _script(self, request: web.Request) -> web.Response:
        return web.Response(body=(await self._viewer()).script, content_type="text/javascript", charset="utf-8")

    async def _wasm(self, request: web.Request) -> web.Response:
        return web.Response(body=(await self._viewer()).wasm, content_type="application/wasm")

    async def _viewer(self) -> Assets:
        if self._assets is None:
            self._assets = asyncio.get_running_loop().run_in_executor(None, extract)
        try:
            return await asyncio.shield(self._assets)
        except SrlError as error:
            self._assets = None  # the next page tries again
            print(f"viewer: {error}", file=sys.stderr, flush=True)
            raise web.HTTPServiceUnavailable(text=f"{error}\n") from None
