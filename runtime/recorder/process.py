"""The recorder where rerun is: its segments are merged into one `.rrd` in a thread, as they are closed."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.child import FINAL
from srl.runtime.recorder import base
from srl.runtime.recorder.base import INCOMPLETE, BaseRecorder
from srl.runtime.recorder.merge import Merger
from srl.runtime.recorder.stream import Stream
from srl.runtime.recorder.tail import Batch
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.recording.segments import Segments, listed
from srl.runtime.recording.source import Source


class Recorder(BaseRecorder):
    """One run's recorder."""

    def _begin(self) -> Segments:
        self._stream = Stream(self._tail.text)
        self._binary = self._stream.recording.binary_stream()
        self._stream.head()
        head = self._binary.read()
        prologue = head[:HEADER] + strip(head)
        self._merger = Merger(self._target, self._tail.text, prologue, base.say)
        self._worker = ThreadPoolExecutor(1, "merge")
        self._merging: Future[None] | None = None
        self._closed: list[Path] = []  # the segments of the last merge
        self._unmerged = False
        return Segments(self._folder, prologue)

    def run(self) -> int:
        """Records until the run ends, then merges the rest. Returns the exit code."""
        if self._done:
            return self._exit_code(sum(len(sequence) for sequence, _ in Source([self._target]).blocks()))
        try:
            stored = self._record()
        finally:
            self._merger.hurry()
            self._close()
            self._worker.shutdown()
        if not stored:
            base.say(f"the disk stayed full: new rows are in the ring, the rest in {self._folder}")
            return INCOMPLETE
        try:
            self._merger.finish()
        except RecordingError as error:
            base.say(str(error))
            return FINAL if self._target.exists() or not self._ring.head else INCOMPLETE
        finally:
            self._merger.close()
            os.close(self._claim)
        return self._exit_code(self._merger.rows)

    def _finished(self) -> bool:
        """Whether an earlier recorder of this run had put the recording in its place before it was killed."""
        if not self._target.exists() or listed(self._folder) or not self._ring.closed:
            return False
        if self._ring.consumed != self._ring.head or not self._ring.head:
            return False
        try:
            mine = Source([self._target]).head() == self._tail.text
        except RecordingError:
            return False
        if mine and self._folder.is_dir():
            self._folder.rmdir()
        return mine

    def _between_batches(self) -> None:
        """Has the closed segments merged beside the recording. What fails is tried again with the next segment."""
        if self._merging is not None:
            if not self._merging.done():
                return
            error = self._merging.exception()
            if error is not None and not self._unmerged:
                base.say(f"{error} (it is tried again)")
            elif error is None and self._unmerged:
                base.say(f"{self._folder}: merging again")
            self._segments.merged(self._merger.added)
            self._merger.added.clear()
            self._unmerged = error is not None
        closed = self._segments.closed
        if not closed:
            self._merging = None
        elif not (self._unmerged and closed == self._closed):
            self._closed = closed
            self._merging = self._worker.submit(self._grow, closed)

    def _grow(self, closed: list[Path]) -> None:
        """Merges segments."""
        self._merger.merge(closed)
        self._apply_retention()

    def _encoded(self, batch: Batch) -> bytes:
        self._stream.pack(batch.sequence, batch.rows, quick=True)
        self._stream.events(batch.numbers, batch.events)
        return strip(self._binary.read())
