"""A made-up loop whose rows and events are those of a recording."""

from __future__ import annotations

import time

import numpy as np

from helpers.panel import MadeUpLoop
from srl.runtime.ipc.events import EventWriter
from srl.runtime.ipc.header import CYCLE

WALL = 1_700_000_000_000_000_000  # ns


class ViewedLoop(MadeUpLoop):
    """Its rows have the times that a recording needs, and it has events."""

    def begin(self) -> None:
        self.layout.meta |= {"wall": WALL, "profile": "name: made-up\n", "sha256": "0" * 64}
        super().begin()
        self.events = EventWriter(self.folder.events)
        self.times: list[float] = []

    def step(self, at: float | None = None) -> None:
        self.cycle += 1
        row = np.zeros(self.layout.width, np.int64)
        now = time.monotonic_ns() if at is None else round(at * 1e9)
        for word in ("now", "deadline", "wake", "read", "control", "guard", "write"):
            row[getattr(CYCLE, word)] = now
        row[CYCLE.cycle], row[CYCLE.state] = self.cycle, self.state
        row[self.layout.device(0)][:2] = now, self.link
        row[self.layout.ints :] = np.array([self.value, self.held, 0.0]).view(np.int64)
        self.times.append(now / 1e6)
        self.ring.append(row)

    def time_of(self, cycle: int) -> float:
        """CLOCK_MONOTONIC ms of a cycle."""
        return self.times[cycle - 1]
