"""Follows the rows of an instance, also when its loop is started again, and says whether they are worth believing."""

from __future__ import annotations

import os
from collections.abc import Callable
from enum import StrEnum

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, LINK_STALE, Cause, State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

SILENCE = 0.1  # s without a row after which the newest counts as old; three periods of a slower loop
LOOK = 0.25  # s between looks for the files of a new run
_WAITS = {State.STARTING: "starts", State.READY: "waits for its start", State.HOMING: "goes to its home"}


class Condition(StrEnum):
    """Whether what is shown follows the limb and the person now."""

    LIVE = "live"
    HELD = "held"  # a device gives nothing new, or a law says that it holds its value
    STOPPED = "stopped"  # the limb is stopped, or not yet started
    SILENT = "silent"  # the loop writes no rows: it hangs, or it was killed
    ENDED = "ended"  # the run is over, or there is none


class Rows:
    """One reader's place in an instance's rows.

    Attributes:
        layout: of the rows.
        last: the newest row (width,); None before the first.
        generation: grows by one with each new run of the loop.
    """

    layout: Layout
    last: Words | None

    def __init__(self, run_folder: RunFolder, fits: Callable[[Layout], None] = lambda _: None) -> None:
        """Opens the rows.

        Args:
            run_folder: the instance's folder.
            fits: raises RecordingError for a layout that lacks what the caller needs.
        Raises:
            RecordingError: there is no run here, or its layout doesn't fit.
        """
        self._folder, self._fits = run_folder, fits
        self.generation, self._cycle = 0, -1
        self._next_look = 0.0
        self._files: tuple[int, ...] = ()
        self._open()

    def take(self, now: float) -> Words:
        """Returns the new rows (k, width). `now`: CLOCK_MONOTONIC s."""
        self._look(now)
        rows = self._ring.take()
        if len(rows):
            cycles = self.layout.header(rows, "cycle")
            if cycles[0] <= self._cycle or np.any(np.diff(cycles) <= 0):
                self.generation += 1  # the same files, written on by a new loop
            self._cycle, self.last = int(cycles[-1]), rows[-1]
        return rows

    @property
    def lost(self) -> int:
        """Number of rows that were overwritten before they were read."""
        return self._ring.lost

    @property
    def stamp(self) -> float:
        """CLOCK_MONOTONIC s at which the laws of the newest row's cycle had ended; 0 before the first row."""
        return 0.0 if self.last is None else int(self.layout.header(self.last, "control")) / 1e9

    def condition(self, now: float) -> tuple[Condition, str]:
        """The condition, and the words for people; empty if it is live. `now`: CLOCK_MONOTONIC s."""
        row = self.last
        if row is None:
            return Condition.SILENT, "The system gives no data"
        if self._ring.closed:
            return Condition.ENDED, "The run is over"
        if now - self.stamp > self._silence:
            return Condition.SILENT, "The system gives no data"
        state = State(int(self.layout.header(row, "state")))
        if state in _WAITS:
            return Condition.STOPPED, f"The limb {_WAITS[state]}"
        if state is not State.ACTIVE:
            cause = Cause(int(self.layout.header(row, "cause"))).name.lower().replace("_", " ")
            return Condition.STOPPED, f"The limb is stopped ({cause})"
        for index, name in enumerate(self.layout.devices):
            link = int(row[self.layout.device(index)][DEVICE.link])
            if not link & LINK_CONNECTED or link & LINK_STALE:
                return Condition.HELD, f"Nothing new from {name}"
        return Condition.LIVE, ""

    def close(self) -> None:
        """Unmaps the rows."""
        self._ring.close()

    def _open(self) -> None:
        files = self._on_disk()
        layout = Layout.load(self._folder.layout)
        ring = RingReader(self._folder.rows, width=layout.width)
        ring.sequence = max(ring.head - 1, 0)  # only the newest row of what was before
        try:
            self._fits(layout)
        except RecordingError:
            ring.close()
            raise
        self.layout, self._ring, self._files = layout, ring, files
        self._cycle, self.last = -1, None
        rate = layout.meta["rate"]
        self._silence = max(SILENCE, 3 * rate[1] / rate[0])

    def _on_disk(self) -> tuple[int, ...]:
        """What tells the files of one run from those of the next; empty if they aren't there."""
        try:
            rows, layout = os.stat(self._folder.rows), os.stat(self._folder.layout)
            return rows.st_ino, layout.st_ino, layout.st_mtime_ns
        except FileNotFoundError:
            return ()

    def _look(self, now: float) -> None:
        """Opens the files of a new run, when they are there."""
        if now < self._next_look:
            return
        self._next_look = now + LOOK
        files = self._on_disk()
        if not files or files == self._files:
            return
        old = self._ring
        try:
            self._open()
        except RecordingError:
            return  # the new run is being set up: layout and rows don't fit yet
        old.close()
        self.generation += 1
