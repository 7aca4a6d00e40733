"""The recorder where rerun isn't: the segments, in the plain form, are the recording."""

from __future__ import annotations

import os

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.recorder import base
from srl.runtime.recorder.base import INCOMPLETE, BaseRecorder
from srl.runtime.recorder.tail import Batch
from srl.runtime.recording import plain
from srl.runtime.recording.blocks import MOST, kin, pack
from srl.runtime.recording.plain import ENDING, START, Kind, end_record, events_record, record
from srl.runtime.recording.segments import Segments, listed
from srl.runtime.recording.source import Source


class PlainRecorder(BaseRecorder):
    """One run's recorder."""

    def run(self) -> int:
        """Records until the run ends. Returns the exit code."""
        if not self._done:
            try:
                stored = self._record() and self._store(end_record(self._ring.consumed), 0)
            finally:
                self._close()
                os.close(self._claim)
            if not stored:
                base.say(f"the disk stayed full: new rows are in the ring, the rest in {self._folder}")
                return INCOMPLETE
        # A run's recording may take longer to read than its recorder has at the end; another's part must be read.
        rows = self._written
        if self._done or self._continued:
            rows = sum(len(sequence) for sequence, _ in Source(listed(self._folder)).blocks())
        if not rows:
            raise RecordingError(str(self._target), "no row was recorded", "The run ended before its first cycle")
        code = self._exit_code(rows)
        if code == base.WELL:
            base.say(f"the recording is the folder {self._folder}: rerun isn't installed here (docs/install.md)")
        return code

    _written, _continued = 0, False

    def _begin(self) -> Segments:
        self._continued = bool(listed(self._folder))  # by a recorder that was killed
        self._near = kin(self._layout)
        return Segments(self._folder, START + record(Kind.LAYOUT, self._tail.text.encode()), ENDING)

    def _encoded(self, batch: Batch) -> bytes:
        parts = []
        self._written += len(batch.rows)
        for at in range(0, len(batch.rows), MOST):
            part = slice(at, at + MOST)
            block = pack(batch.sequence[part], batch.rows[part], self._layout.ints, self._near, quick=True)
            parts.append(record(Kind.ROWS, block))
        if batch.events:
            parts.append(events_record(batch.numbers, batch.events))
        return b"".join(parts)

    def _between_batches(self) -> None:
        self._apply_retention()

    def _finished(self) -> bool:
        if not self._ring.closed or self._ring.consumed != self._ring.head or not self._ring.head:
            return False
        files = listed(self._folder)
        try:
            return plain.ended(files) and Source(files).head() == self._tail.text
        except RecordingError:
            return False
