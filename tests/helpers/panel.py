"""A made-up loop for the participant's screen: rows in a real ring, and the loop's socket for stops."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.run_folder import RunFolder

PERIOD = 0.01  # s
SIGNAL = "law.c"


def shown(page: str) -> dict[str, str]:
    """The headers with which a page speaks to its server, from its own text: the key that it was given."""
    (key,) = re.findall(r'<meta name="key" content="([^"]+)">', page)
    return {"X-Srl-Key": key, "Sec-WebSocket-Protocol": f"srl, {key}"}


class MadeUpLoop:
    """Writes a row each time that it is told to; `running` does so at 100 Hz.

    Attributes:
        value: of the signal; state: of the state machine; link: of its only device; held: of the signal `law.held`.
        stops: number of stops that came.
    """

    def __init__(self, path: Path) -> None:
        path.mkdir(parents=True, exist_ok=True)
        self.folder = RunFolder(path)
        self.layout = Layout(devices=["vicon"])
        self.layout.add(SIGNAL, "internal", (1,), "1")
        self.layout.add("law.held", "internal", (2,), "1", labels=("elbow", "wrist"))
        self.layout.meta = {"name": "made-up", "rate": [100, 1]}
        self.value, self.state, self.held = 0.5, State.ACTIVE, 0.0
        self.link = LINK_CONNECTED | LINK_ACTIVE
        self.stops = 0
        self.begin()

    def begin(self) -> None:
        """A new run: new files, cycles from 1."""
        self.layout.save(self.folder.layout)
        self.ring = RingWriter.create(self.folder.rows, self.layout.width, 4096)
        self.cycle = 0

    def step(self, at: float | None = None) -> None:
        """Writes one row. `at`: CLOCK_MONOTONIC s, now by default."""
        self.cycle += 1
        row = np.zeros(self.layout.width, np.int64)
        row[CYCLE.cycle], row[CYCLE.state] = self.cycle, self.state
        row[CYCLE.control] = round((time.monotonic() if at is None else at) * 1e9)
        row[self.layout.device(0)][DEVICE.link] = self.link
        row[self.layout.ints :] = np.array([self.value, self.held, 0.0]).view(np.int64)
        self.ring.append(row)

    @contextlib.contextmanager
    def running(self) -> Iterator[MadeUpLoop]:
        """Writes rows meanwhile, and answers stops."""
        over = threading.Event()
        stops = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.folder.stop_socket.unlink(missing_ok=True)
        stops.bind(str(self.folder.stop_socket))
        stops.setblocking(False)

        def run() -> None:
            while not over.wait(PERIOD):
                with contextlib.suppress(BlockingIOError):
                    data, sender = stops.recvfrom(2048)
                    assert json.loads(data)["ask"] == "stop"
                    self.stops += 1
                    self.state = State.STOPPED
                    stops.sendto(json.dumps({"ok": True, "state": "stopped"}).encode(), sender)
                self.step()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield self
        finally:
            over.set()
            thread.join()
            stops.close()
            self.folder.stop_socket.unlink()
