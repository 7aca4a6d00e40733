"""The recorder's loop: it writes rows and events from the rings to segments, and merges them at the end to one file.

It can be killed at any moment and started again: the ring's `consumed` advances only over rows that have left this
process, and later rows are still in the ring. Rows that were written twice because of a kill are dropped on reading.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from runtime.contracts.errors import RecordingError
from runtime.ipc.child import Ending
from runtime.ipc.run_folder import RunFolder
from runtime.recorder.merge import covers, merge, remove
from runtime.recorder.stream import Stream
from runtime.recorder.tail import Tail
from runtime.recording.framing import HEADER, strip
from runtime.recording.reader import check_run
from runtime.recording.segments import Segments, check_target, folder_of, listed

RETRY = 0.5  # s between attempts to write to a full disk
PATIENCE = 10.0  # s after the run's end during which the recorder waits for room on a full disk

WELL, INCOMPLETE = 0, 1


class Recorder:
    """One run's recorder."""

    def __init__(self, run: RunFolder, target: Path, ending: Ending | None = None) -> None:
        """Opens the rings and finds where to begin or to continue.

        Raises:
            RecordingError: there is no run, or a recording of another run exists at the target.
        """
        self._target = target
        self._tail = Tail(run, recorder=True, ending=ending)
        self._ring = self._tail.ring
        self._segments_there = bool(listed(folder_of(target)))
        if self._segments_there:
            check_run(folder_of(target), self._tail.text)
            self._ring.sequence = self._ring.consumed
        elif not target.exists():
            check_target(target)
        self._stream = Stream(self._tail.text)
        self._binary = self._stream.recording.binary_stream()
        self._stream.prologue(self._ring.newest())
        head = self._binary.read()
        self._segments = Segments(folder_of(target), head[:HEADER] + strip(head))
        for problem in self._stream.problems:
            say(problem)
        self._stuck = False
        self._lost = 0

    def run(self) -> int:
        """Records until the run ends, then merges. Returns the exit code."""
        if self._target.exists():
            return self._tidy()
        try:
            stored = self._record()
        finally:
            self._segments.close()
        if not stored:
            say(f"the disk stayed full: new rows are in the ring, the rest in {folder_of(self._target)}")
            return INCOMPLETE
        try:
            rows = merge(self._target)
        except RecordingError as error:
            say(str(error))
            return INCOMPLETE
        if self._lost:
            say(f"{self._target}: {rows} rows, {self._lost} were lost")
            return INCOMPLETE
        return WELL

    def _record(self) -> bool:
        """Takes rows until no more will follow. Returns False if there was no room for the last ones."""
        while True:
            batch, over = self._tail.next()
            if over:
                return True
            if self._ring.lost > self._lost:
                say(f"{self._ring.lost - self._lost} rows were overwritten before they could be written")
                self._lost = self._ring.lost
            if not batch:
                continue
            self._stream.rows(batch.sequence, batch.rows)
            self._stream.events(batch.numbers, batch.events)
            if not self._store(strip(self._binary.read())):
                return False
            self._ring.set_consumed(self._ring.sequence)

    def _store(self, data: bytes) -> bool:
        """Writes messages and waits for room if necessary. Returns False if the run is over without room."""
        over_since = None
        while True:
            try:
                self._segments.write(data)
            except OSError as error:
                if not self._stuck:
                    say(f"{folder_of(self._target)}: can't write ({error.strerror}); will try again")
                self._stuck = True
            else:
                if self._stuck:
                    say(f"{folder_of(self._target)}: recording again")
                self._stuck = False
                return True
            if self._tail.over:
                over_since = over_since or time.monotonic()
                if time.monotonic() - over_since > PATIENCE:
                    return False
            time.sleep(RETRY)

    def _tidy(self) -> int:
        """Cleans up after an earlier recorder of this run that was killed between merging and removing segments."""
        if not self._segments_there or not self._ring.closed or not covers(self._target, self._ring.head):
            check_target(self._target)
        remove(folder_of(self._target))
        return WELL


def say(text: str) -> None:
    """Prints a line for people."""
    print(f"recorder: {text}", file=sys.stderr, flush=True)
