"""The recorder's loop: it writes rows and events from the rings to segments. What they are is for its subclasses.

It can be killed at any moment and started again: the ring's `consumed` advances only over rows that have left this
process, and later rows are still in the ring. Rows that were written twice because of a kill are dropped on reading.
"""

from __future__ import annotations

import sys
import time
from abc import ABC, abstractmethod
from pathlib import Path

from srl.runtime.ipc.child import FINAL, Ending
from srl.runtime.ipc.control_socket import NOTES, send_note
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.recorder.tail import Batch, Tail
from srl.runtime.recording.keep import LEDGER, Keep, make_room
from srl.runtime.recording.reader import check_run
from srl.runtime.recording.segments import Segments, check_target, claim, folder_of, listed
from srl.runtime.recording.summary import persons

RETRY = 0.5  # s between attempts to write to a full disk
LOOK = 60.0  # s between looks at what the folder needn't keep
TIMEOUT = 10.0  # s after the run's end during which the recorder waits for room on a full disk

WELL, INCOMPLETE = 0, 1  # exit codes, beside FINAL


class BaseRecorder(ABC):
    """One run's recorder."""

    def __init__(self, run: RunFolder, target: Path, ending: Ending | None = None) -> None:
        """Opens the rings and finds where to begin or to continue.

        Raises:
            RecordingError: there is no run, or a recording of another run exists at the target.
        """
        self._run, self._target, self._folder = run, target, folder_of(target)
        self._tail = Tail(run, ending)
        self._ring = self._tail.ring
        self._done = self._finished()
        if self._done:
            return
        if listed(self._folder):
            check_run(self._folder, self._tail.text)
            self._ring.sequence = self._ring.consumed
        else:
            check_target(target)
        self._claim = claim(self._folder)
        self._layout = Layout.from_json(self._tail.text)
        self._segments = self._begin()
        self._stuck = False
        self._lost = 0
        meta = self._layout.meta
        self._keep, self._mine = Keep.of((meta.get("record") or {}).get("keep")), persons(self._layout)
        self._looked, self._full = time.monotonic(), ""  # what starts a run has just looked
        self._last_texts: list[str] = []  # in the last look

    @abstractmethod
    def run(self) -> int:
        """Records until the run ends. Returns the exit code."""

    @abstractmethod
    def _begin(self) -> Segments:
        """Prepares the form of the segments."""

    @abstractmethod
    def _encoded(self, batch: Batch) -> bytes:
        """A batch as a segment holds it."""

    @abstractmethod
    def _between_batches(self) -> None:
        """What is done between batches."""

    @abstractmethod
    def _finished(self) -> bool:
        """Whether an earlier recorder of this run had finished before it was killed."""

    def _exit_code(self, rows: int) -> int:
        """Whether the recording holds every row that was made; the exit code."""
        if lost := self._ring.consumed - rows:  # also by a recorder before this one
            say(f"{self._target}: {rows} rows, {lost} were lost")
            return FINAL
        return WELL

    def _apply_retention(self) -> None:
        """Now and then deletes what the folder needn't keep."""
        if time.monotonic() - self._looked > LOOK:
            self._looked = time.monotonic()
            texts: list[str] = []
            full = make_room(self._folder.absolute().parent, self._keep, self._mine, texts.append)
            if full and not self._full:
                texts.append(f"{self._folder.absolute().parent}: {full}; this run is recorded all the same")
            self._full = full
            self._note([text for text in texts if text not in self._last_texts])  # not each minute that nothing can go
            self._last_texts = texts

    def _note(self, texts: list[str]) -> None:
        """Says what happens to recordings, and has it written among the run's events, which take few at once."""
        for text in texts:
            say(text)
        if len(texts) > NOTES:
            more = f"and {len(texts) - NOTES + 1} more of the like; all deletions are in {LEDGER}"
            texts = [*texts[: NOTES - 1], more]
        for text in texts:
            send_note(self._run, text)

    def _close(self) -> None:
        """Ends the last segment."""
        try:
            self._segments.close()
        except OSError as error:
            say(f"{self._folder}: what was deleted there can't be written again ({error.strerror})")

    def _record(self) -> bool:
        """Takes rows until no more will follow. Returns False if there was no room for the last ones."""
        while True:
            batch, over = self._tail.next()
            if over:
                return True
            if self._ring.lost > self._lost:
                say(f"{self._ring.lost - self._lost} rows were overwritten before they could be written")
                self._lost = self._ring.lost
            self._between_batches()
            if not batch:
                continue
            if not self._store(self._encoded(batch), batch.rows.nbytes):
                return False
            self._ring.set_consumed(self._ring.sequence)

    def _store(self, data: bytes, weight: int) -> bool:
        """Writes messages and waits for room if necessary. Returns False if the run is over without room."""
        over_since = None
        while True:
            try:
                self._segments.write(data, weight)
            except OSError as error:
                if not self._stuck:
                    say(f"{self._folder}: can't write ({error.strerror}); will try again")
                self._stuck = True
            else:
                if self._stuck:
                    say(f"{self._folder}: recording again")
                self._stuck = False
                return True
            if self._tail.over:
                over_since = over_since or time.monotonic()
                if time.monotonic() - over_since > TIMEOUT:
                    return False
            time.sleep(RETRY)


def say(text: str) -> None:
    """Prints a line for people."""
    print(f"recorder: {text}", file=sys.stderr, flush=True)
