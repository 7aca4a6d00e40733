"""Follows a run: reads new rows and events from its rings in batches until no more will follow."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc import private_file
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.events import Event, EventReader
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

BATCH = 4096  # rows at once, at most
FLUSH = 0.2  # s between batches, at most
POLL = 0.005  # s
SILENCE = 1.0  # s without a row after which a run counts as ended, if this process was told to end


@dataclass(frozen=True)
class Batch:
    """Rows (k, width) and events with their sequence numbers. It is false if it has neither."""

    sequence: Words
    rows: Words
    numbers: range
    events: list[Event]

    def __bool__(self) -> bool:
        return len(self.rows) > 0 or len(self.events) > 0


class Tail:
    """One reader's position in a run.

    Attributes:
        text: the layout's JSON.
        ring: the rows; `ring.lost` counts the rows that were overwritten before they were read.
    """

    def __init__(self, run: RunFolder, ending: Ending | None = None) -> None:
        """Opens the rings.

        Args:
            run: the run's folder.
            ending: whether this process is to end. Then it does so once the loop is silent: stopping a service
                signals all its processes, and the loop's own stop takes a while and must be recorded.
        Raises:
            RecordingError: there is no run, or its files are damaged.
        """
        if not run.layout.exists():
            raise RecordingError(str(run.path), "no run is here", "Start it first")
        self.text = private_file.read_text(run.layout)
        width = Layout.from_json(self.text, str(run.layout)).width
        self.ring = RingReader(run.rows, marks=True, width=width)
        self._events = EventReader(run.events)
        self._due = 0.0
        self._ending = ending
        self._last_row = time.monotonic()

    def next(self) -> tuple[Batch, bool]:
        """Waits for the next batch and returns it; True with an empty batch if nothing will follow."""
        while True:
            over = self.over  # read first: rows from before the end are taken below
            waiting = self.ring.head - self.ring.sequence
            now = time.monotonic()
            if over or now >= self._due or waiting >= min(BATCH, self.ring.capacity // 4):
                self._due = now + FLUSH
                batch = self._take()
                return batch, over and not batch
            time.sleep(POLL)

    @property
    def over(self) -> bool:
        """True once no row will follow: the ring is closed, or the loop is silent and this process was told to end."""
        if self.ring.closed:
            return True
        asked = self._ending is not None and self._ending.asked
        return asked and time.monotonic() - self._last_row > SILENCE and self.ring.head == self.ring.sequence

    def _take(self) -> Batch:
        events = self._events.take()
        numbers = range(self._events.sequence - len(events) + 1, self._events.sequence + 1)
        rows = self.ring.take(BATCH)
        if len(rows):
            self._last_row = time.monotonic()
        sequence = np.arange(self.ring.sequence - len(rows) + 1, self.ring.sequence + 1)
        return Batch(sequence, rows, numbers, events)
