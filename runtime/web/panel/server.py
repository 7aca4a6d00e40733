"""The server of the participant's screen: trials, and the pointer as the loop's rows have it."""

from __future__ import annotations

import json
import math
import time
from typing import Any, ClassVar

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.pages import KEEP, PageServer
from srl.runtime.web.panel.peer import BadMessageError, Peer, frame_rows, number
from srl.runtime.web.panel.session import Session
from srl.runtime.web.panel.source import Reading, Source


class Server(PageServer):
    """Serves one instance's screen. Its first page is the participant's."""

    called: ClassVar = "the participant's screen"

    files: ClassVar = {
        "/": ("index.html", "text/html"),
        "/screen.js": ("screen.js", "text/javascript"),
        "/link.js": ("link.js", "text/javascript"),
        "/drawing.js": ("drawing.js", "text/javascript"),
        "/screen.css": ("screen.css", "text/css"),
    }

    def __init__(self, run_folder: RunFolder, source: Source) -> None:
        super().__init__(run_folder)
        self.session = Session()
        self._source = source
        self._shown, self._due = (0.0, ""), 0.0
        self.session.changed = self._tell

    def joined(self, peer: Peer) -> None:
        peer.participant = not any(p.participant for p in self.peers)
        peer.tell({"kind": "hello", "participant": peer.participant})
        peer.tell({"kind": "state", **self.session.state()})

    def heard(self, peer: Peer, message: dict[str, Any]) -> None:
        now = time.monotonic()
        match message.get("kind"):
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
                super().heard(peer, message)

    def left(self, peer: Peer) -> None:
        if peer.participant and self.session.began:
            self.session.abort("the page was closed", time.monotonic())

    def stopped(self) -> None:
        self.session.abort("stopped on the screen", time.monotonic())

    def look(self) -> None:
        now = time.monotonic()
        rows, reading = self._source.take(now)
        self.session.tick(rows, reading, self._source.lost, now)
        if (reading.stamp, reading.words) != self._shown or now >= self._due:
            self._shown, self._due = (reading.stamp, reading.words), now + KEEP
            text = _value(reading)
            for peer in self.peers:
                peer.show(text)

    def close(self) -> None:
        self._source.close()

    def _tell(self) -> None:
        for peer in self.peers:
            peer.tell({"kind": "state", **self.session.state()})


def _value(reading: Reading) -> str:
    value = reading.value if math.isfinite(reading.value) else None
    message = {"kind": "value", "t": reading.stamp * 1e3, "y": value}
    return json.dumps(message | {"condition": reading.condition, "words": reading.words})
