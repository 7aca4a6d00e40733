"""A made-up loop for the operator's panel: it answers starts and resets, and takes presses as `srl jog --panel`."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from helpers.panel import MadeUpLoop
from srl.runtime.ipc.header import CYCLE, DEVICE, Cause, Latch, State

JOINTS = ("shoulder", "elbow")


class OperatedLoop(MadeUpLoop):
    """With a parameter, and the law `jog` over two joints.

    Attributes:
        asked: datagrams that asked for a start or reset.
        judged: those of them that came as to a run of `srl jog --panel`.
        refuses: what it says to them; "" lets them pass.
        presses: datagrams of the jog, with the CLOCK_MONOTONIC ns at which they came.
        cause, latches: words of the rows.
    """

    def __init__(self, path: Path) -> None:
        self.asked: list[dict[str, Any]] = []
        self.presses: list[tuple[int, dict[str, Any]]] = []
        self.judged: list[dict[str, Any]] = []
        self.refuses = ""
        self.cause, self.latches = Cause.NONE, Latch(0)
        super().__init__(path)

    def begin(self) -> None:
        if "terminal.way" not in self.layout.fields:
            self.layout.devices = ["vicon", "terminal"]
            self.layout.add("terminal.way", "setpoint", (2,), "1", labels=JOINTS)
            self.layout.add("arm.command", "command", (2,), "rad", labels=JOINTS)
            self.layout.add("arm.command.applied", "applied", (2,), "rad", labels=JOINTS)
            self.layout.add("jog.gain", "parameter", (), "1/m")
            self.layout.meta |= {
                "controllers": [{"name": "jog", "use": "jog"}],
                "commands": {"arm.command": {"kind": "position"}},
                "limits": {"arm.command": {"lower": [-1.0, None], "upper": [1.0, None]}},
                "setpoints": [{"name": "terminal.way", "max_age": 0.5}],
                "parameters": [
                    {"name": "jog.gain", "lower": 0.5, "upper": 2.0, "unit": "1/m", "text": "gain", "default": 1.0}
                ],
            }
        super().begin()

    def step(self, at: float | None = None) -> None:
        self.cycle += 1
        now = time.monotonic_ns() if at is None else round(at * 1e9)
        row = np.zeros(self.layout.width, np.int64)
        row[CYCLE.cycle], row[CYCLE.state], row[CYCLE.cause] = self.cycle, self.state, self.cause
        row[CYCLE.latches], row[CYCLE.fault_source] = self.latches, 0
        row[CYCLE.now] = row[CYCLE.wake] = row[CYCLE.control] = now
        for index in range(2):
            words = row[self.layout.device(index)]
            words[DEVICE.link], words[DEVICE.stamp] = self.link, now - 2_000_000
        values = [self.value, self.held, 0.0, 0.0, 0.0, 0.1, 0.2, 0.1, 0.2, 1.25]
        row[self.layout.ints :] = np.array(values).view(np.int64)
        self.ring.append(row)

    @contextlib.contextmanager
    def running(self) -> Iterator[OperatedLoop]:
        """Writes rows meanwhile, and answers stops, starts, resets; presses are kept."""
        over = threading.Event()
        ends = {path: _bound(path) for path in (self.folder.loop_socket, self.folder.press_socket)}
        asks, presses = ends.values()

        def answered(asked: dict[str, Any]) -> bytes:
            self.asked.append(asked)
            if not self.refuses:
                self.state, self.cause, self.latches = State.ACTIVE, Cause.NONE, Latch(0)
            answer = {"ok": not self.refuses, "state": self.state.name.lower(), "error": self.refuses}
            return json.dumps(answer).encode()

        def run() -> None:
            while not over.is_set():
                with contextlib.suppress(TimeoutError):
                    data, sender = asks.recvfrom(2048)
                    asks.sendto(answered(json.loads(data)), sender)

        def listen() -> None:
            while not over.is_set():
                with contextlib.suppress(TimeoutError):
                    data, sender = presses.recvfrom(2048)
                    content = json.loads(data)
                    if "ask" in content:
                        self.judged.append(content)
                        presses.sendto(answered(content), sender)
                    else:
                        self.presses.append((time.monotonic_ns(), content))

        threads = [threading.Thread(target=run), threading.Thread(target=listen)]
        for thread in threads:
            thread.start()
        try:
            with super().running():
                yield self
        finally:
            over.set()
            for thread in threads:
                thread.join()
            for path, end in ends.items():
                end.close()
                path.unlink(missing_ok=True)


def _bound(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.bind(str(path))
    made.settimeout(0.01)
    return made
