"""The control value as the loop's rows have it, and whether it can be believed. It only reads."""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from runtime.contracts.errors import RecordingError
from runtime.contracts.signals import Array
from runtime.ipc.layout import Layout
from runtime.ipc.ring import RingReader
from runtime.ipc.run_folder import RunFolder
from runtime.ipc.words import DEVICE, LINK_CONNECTED, LINK_STALE, Cause, State
from runtime.profile.plots import pick
from runtime.recording.columns import Words

SILENCE = 0.1  # s without a row after which the value counts as old; three periods of a slower loop
LOOK = 0.25  # s between looks for the files of a new run
_WAITS = {State.STARTING: "starts", State.READY: "waits for its start", State.HOMING: "goes to its home"}


class Condition(StrEnum):
    """Whether the value follows the participant now."""

    LIVE = "live"
    HELD = "held"  # a device gives nothing new, or the law says that it holds its value
    STOPPED = "stopped"  # the limb is stopped, or not yet started
    SILENT = "silent"  # the loop writes no rows: it hangs, or it was killed
    ENDED = "ended"  # the run is over, or there is none


@dataclass(frozen=True)
class Reading:
    """What the newest row says.

    Attributes:
        stamp: CLOCK_MONOTONIC s at which the value was known: the end of the cycle's laws. 0: there was no row.
        value: the signal mapped to 0..1, not clamped; NaN if there is none.
        condition: whether it follows the participant now.
        words: the condition for people; empty if it is live.
        generation: grows by one with each new run of the loop.
    """

    stamp: float
    value: float
    condition: Condition
    words: str
    generation: int


class Source:
    """Follows a signal through the rows of an instance, also when its loop is started again."""

    def __init__(
        self, run_folder: RunFolder, signal: str, span: tuple[float, float] = (0.0, 1.0), held: str | None = None
    ) -> None:
        """Opens the rows.

        Args:
            run_folder: the instance's folder.
            signal: one number of the row: "ikns.c", "ikns.c[swivel]".
            span: values of the signal that are shown as 0 and 1, in its unit.
            held: a signal that isn't zero, in any element, while the value is held ("arm.held").
        Raises:
            RecordingError: there is no run here, or its rows lack the signal.
        """
        self._folder, self._signal, self._held = run_folder, signal, held
        self._low, self._high = span
        self._generation, self._cycle = 0, -1
        self._next_look = 0.0
        self._last: Words | None = None
        self._files: tuple[int, ...] = ()
        self._open()

    def take(self, now: float) -> tuple[Array, Reading]:
        """Returns the new rows' times and values, shape (k, 2) (CLOCK_MONOTONIC s, 0..1), and the newest reading.

        Args:
            now: CLOCK_MONOTONIC s.
        """
        self._look(now)
        rows = self._ring.take()
        if len(rows):
            cycles = self._layout.word(rows, "cycle")
            if cycles[0] <= self._cycle or np.any(np.diff(cycles) <= 0):
                self._generation += 1  # the same files, written on by a new loop
            self._cycle, self._last = int(cycles[-1]), rows[-1]
        return self._values(rows), self._reading(now)

    @property
    def lost(self) -> int:
        """Number of rows that were overwritten before they were read."""
        return self._ring.lost

    def close(self) -> None:
        """Unmaps the rows."""
        self._ring.close()

    def _open(self) -> None:
        files = self._on_disk()
        layout = Layout.load(self._folder.layout)
        ring = RingReader(self._folder.rows, width=layout.width)
        ring.sequence = max(ring.head - 1, 0)  # only the newest row of what was before
        self._layout, self._ring, self._files = layout, ring, files
        self._cycle, self._last = -1, None
        rate = layout.meta["rate"]
        self._silence = max(SILENCE, 3 * rate[1] / rate[0])
        try:
            self._values(np.zeros((1, layout.width), np.int64))
        except RecordingError:
            ring.close()
            raise

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
        self._generation += 1

    def _values(self, rows: Words) -> Array:
        place = "the participant's screen"
        values = pick(self._layout, rows, self._signal, place)
        if values.ndim != 1:
            problem = f"'{self._signal}' has {int(np.prod(values.shape[1:]))} numbers, and one is shown"
            raise RecordingError(place, problem, f"Say which, for example '{self._signal}[NAME]'")
        if self._held is not None:
            pick(self._layout, rows[:0], self._held, place)
        times = self._layout.word(rows, "control") / 1e9
        return np.column_stack([times, (values - self._low) / (self._high - self._low)])

    def _reading(self, now: float) -> Reading:
        if self._last is None:
            return Reading(0.0, float("nan"), Condition.SILENT, "The system gives no data", self._generation)
        stamp, value = self._values(self._last[None])[0].tolist()
        condition, words = self._condition(now - stamp, value)
        return Reading(stamp, value, condition, words, self._generation)

    def _condition(self, age: float, value: float) -> tuple[Condition, str]:
        row = self._last
        assert row is not None
        if self._ring.closed:
            return Condition.ENDED, "The run is over"
        if age > self._silence:
            return Condition.SILENT, "The system gives no data"
        state = State(int(self._layout.word(row, "state")))
        if state in _WAITS:
            return Condition.STOPPED, f"The limb {_WAITS[state]}"
        if state is not State.ACTIVE:
            cause = Cause(int(self._layout.word(row, "cause"))).name.lower().replace("_", " ")
            return Condition.STOPPED, f"The limb is stopped ({cause})"
        for index, name in enumerate(self._layout.devices):
            link = int(row[self._layout.device(index)][DEVICE.link])
            if not link & LINK_CONNECTED or link & LINK_STALE:
                return Condition.HELD, f"Nothing new from {name}: the value is held"
        if not np.isfinite(value):
            return Condition.HELD, "There is no value"
        if self._held is not None and np.any(pick(self._layout, row[None], self._held, self._held)):
            return Condition.HELD, "You can't be seen: the value is held"
        return Condition.LIVE, ""
