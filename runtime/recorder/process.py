"""The recorder's loop: rows and remarks from the rings to segments, and at the end to one file.

It can be killed at any moment and started again: what was written is found in the segments, what wasn't is
still in the ring, as the ring's `consumed` moves only over rows that have left this process.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from runtime.errors import RecordingError
from runtime.notes import Note, NotesReader
from runtime.recorder.columns import Words
from runtime.recorder.framing import HEADER, strip
from runtime.recorder.merge import covers, merge, remove
from runtime.recorder.reader import last_recorded
from runtime.recorder.segments import Segments, check_target, folder_of, listed
from runtime.recorder.stream import Stream
from runtime.recorder.viewer import Viewer
from runtime.ring import RingReader
from runtime.rundir import RunDir

FLUSH = 0.2  # s between writes, at most
BATCH = 4096  # rows a write, at most
POLL = 0.005  # s
RETRY = 0.5  # s between tries on a full disk
PATIENCE = 10.0  # s that a full disk is waited for after the run's end
SILENCE = 1.0  # s without a row after which a run that was told to end has ended

WELL, INCOMPLETE = 0, 1


class Recorder:
    """One run's recorder."""

    def __init__(self, run: RunDir, target: Path, view: bool) -> None:
        """Opens the rings and finds where to begin, or to go on.

        Raises:
            RecordingError: no run is there, or a recording of another run is in the way.
        """
        self._target = target
        self._ring = RingReader(run.rows, recorder=True)
        self._notes = NotesReader(run.notes)
        try:
            text = run.layout.read_text()
        except OSError as error:
            raise RecordingError(
                str(run.layout), f"no layout is here: {error.strerror}", "Is the run up?"
            ) from None
        self._segments_there = bool(listed(folder_of(target)))
        if self._segments_there:
            self._ring.sequence = last_recorded(folder_of(target), text)
        elif not target.exists():
            check_target(target)
        self._stream = Stream(text)
        self._binary = self._stream.recording.binary_stream()
        self._stream.prologue()
        head = self._binary.read()
        self._segments = Segments(folder_of(target), head[:HEADER] + strip(head))
        self._viewer = Viewer(text) if view else None
        if self._viewer is not None:
            _say(f"viewer: {self._viewer.url}")
        self._asked_to_end = False
        self._parent = os.getppid()
        self._last_row = time.monotonic()
        self._stuck = False
        self._lost = 0

    def run(self) -> int:
        """Records until the run ends, then merges; returns the exit code."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)
        if self._target.exists():
            return self._tidy()
        try:
            stored = self._record()
        finally:
            self._segments.close()
            if self._viewer is not None:
                self._viewer.close()
        if not stored:
            _say(f"the disk stayed full: new rows are in the ring, the rest in {folder_of(self._target)}")
            return INCOMPLETE
        try:
            rows = merge(self._target)
        except RecordingError as error:
            _say(str(error))
            return INCOMPLETE
        if self._lost:
            _say(f"{self._target}: {rows} rows, {self._lost} were lost")
            return INCOMPLETE
        return WELL

    def _record(self) -> bool:
        """Takes rows until there will be no more; False if the last ones found no room."""
        due = 0.0
        while True:
            over = self._over()  # asked first: whatever came before the end is taken below
            waiting = self._ring.head - self._ring.sequence
            now = time.monotonic()
            if not (over or now >= due or waiting >= min(BATCH, self._ring.capacity // 4)):
                time.sleep(POLL)
                continue
            due = now + FLUSH
            data = self._take()
            if data and not self._store(data):
                return False
            self._ring.set_consumed(self._ring.sequence)
            if over and not data:
                return True

    def _take(self) -> bytes:
        """The next rows and remarks as messages; empty if there are none."""
        notes = self._notes.take()
        numbers = range(self._notes.sequence - len(notes) + 1, self._notes.sequence + 1)
        rows = self._ring.take(BATCH)
        if self._ring.lost > self._lost:
            _say(f"{self._ring.lost - self._lost} rows were overwritten before they could be written")
            self._lost = self._ring.lost
        if not len(rows) and not notes:
            return b""
        sequence = np.arange(self._ring.sequence - len(rows) + 1, self._ring.sequence + 1)
        self._stream.rows(sequence, rows)
        self._stream.notes(numbers, notes)
        if len(rows):
            self._last_row = time.monotonic()
        self._show(sequence, rows, list(numbers), notes)
        return strip(self._binary.read())

    def _show(self, sequence: Words, rows: Words, numbers: list[int], notes: list[Note]) -> None:
        if self._viewer is None:
            return
        if not self._viewer.alive:
            _say("the viewer's server has ended; the recording goes on")
            self._viewer = None
            return
        if len(rows):
            self._viewer.rows(sequence, rows)
        self._viewer.stream.notes(numbers, notes)

    def _store(self, data: bytes) -> bool:
        """Writes messages, waiting for room if need be; False if the run is over and there still is none."""
        over_since = None
        while True:
            try:
                self._segments.write(data)
            except OSError as error:
                if not self._stuck:
                    _say(f"{folder_of(self._target)}: can't write ({error.strerror}); will try again")
                self._stuck = True
            else:
                if self._stuck:
                    _say(f"{folder_of(self._target)}: recording again")
                self._stuck = False
                return True
            if self._over():
                over_since = over_since or time.monotonic()
                if time.monotonic() - over_since > PATIENCE:
                    return False
            time.sleep(RETRY)

    def _over(self) -> bool:
        """True once no row will follow: the loop said so, or is silent and we were told to end."""
        if self._ring.closed:
            return True
        told = self._asked_to_end or os.getppid() != self._parent
        return told and time.monotonic() - self._last_row > SILENCE and self._ring.head == self._ring.sequence

    def _ask(self, *_: object) -> None:
        # A service's stop signals all its processes; the loop's own stop takes a while and is to be recorded.
        self._asked_to_end = True

    def _tidy(self) -> int:
        """The merged file is there already: an earlier recorder of this run was killed while tidying up."""
        if not self._segments_there or not self._ring.closed or not covers(self._target, self._ring.head):
            check_target(self._target)
        remove(folder_of(self._target))
        return WELL


def _say(text: str) -> None:
    print(f"recorder: {text}", file=sys.stderr, flush=True)
