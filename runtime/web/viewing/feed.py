"""The run for pages with rerun's viewer: thinned, and made to one stream for each page when the page can take more.

The viewer takes so many messages a frame, however long they are. So what a slow page has missed is joined before it
becomes messages, and the oldest rows are left out; no change of state and no event is.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from typing import Final, Generic, TypeVar

from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.recorder.scene import Thinned
from srl.runtime.recorder.stream import Stream
from srl.runtime.recorder.tail import Batch, Tail
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.web.viewing.mark import Mark

KEPT: Final = 32 << 20  # bytes of rows of the past that a page which is opened late, or is slow, still gets
KEPT_REPORTS: Final = 8 << 20  # bytes of states and events, the same

T = TypeVar("T")


class Kept(Generic[T]):
    """The newest of what came, by number from 0; the oldest go when there are too many bytes."""

    def __init__(self, most: int) -> None:
        self._most, self._size = most, 0
        self._parts: deque[tuple[T, int]] = deque()
        self.count = 0  # that came so far

    def add(self, part: T, size: int) -> None:
        """Adds one of so many bytes."""
        self._parts.append((part, size))
        self.count += 1
        self._size += size
        while self._size > self._most and len(self._parts) > 1:
            self._size -= self._parts.popleft()[1]

    def since(self, number: int) -> list[T]:
        """All that are left from a number on."""
        first = self.count - len(self._parts)
        return [part for part, _ in list(self._parts)[max(number - first, 0) :]]


class Feed:
    """Follows a run in a thread of its own, so that nobody who looks delays it, or is delayed by it.

    Attributes:
        head: the layout, names, fixed shapes and arrangement; whoever looks gets it first.
        over: True once no row will follow.
        failure: what the thread failed with.
    """

    def __init__(self, run: RunFolder, ending: Ending | None = None) -> None:
        """Raises RecordingError: there is no run."""
        self._tail = Tail(run, recorder=False, ending=ending)
        newest = self._tail.ring.newest()
        self._stream = Stream(self._tail.text, apart=True)
        self._out, self._events_out = (
            self._stream.recording.binary_stream(),
            self._stream.events_to.binary_stream(),
        )
        self._stream.prologue(newest, live=True)
        self.head = self._out.read() or b""
        self._start = self.head[:HEADER]
        for problem in self._stream.problems:
            print(f"viewer: {problem}", file=sys.stderr, flush=True)
        self._lock = threading.Lock()  # of the stream, and of what is kept
        self._rows, self._events = Kept[Thinned](KEPT), Kept[bytes](KEPT_REPORTS)
        self.over = False
        self.failure: BaseException | None = None
        self._ends = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def mark(self) -> Mark:
        """That of a page that has everything."""
        return Mark(self._rows.count, self._events.count)

    def since(self, mark: Mark) -> tuple[Mark, float, bytes]:
        """What a page lacks, as one whole stream; empty if it lacks nothing. It takes a while: up to 0.1 s.

        Returns:
            The page's mark from then on, the newest row's time (CLOCK_MONOTONIC ms; 0 if it gets none), the stream.
        """
        if mark == Mark():
            return Mark(0, 0), 0.0, self.head
        with self._lock:
            new = self.mark
            rows, messages = self._rows.since(mark.rows), b"".join(self._events.since(mark.events))
            time = 0.0
            if rows:
                joined = Thinned.joined(rows)
                time = int(self._stream.layout.header(joined.rows, "now")[-1]) / 1e6
                self._stream.show(joined)
                messages += self._messages(self._out.read())
        return new, time, self._start + messages if messages else b""

    def close(self) -> None:
        """Ends the thread."""
        self._ends = True
        self._thread.join(2.0)

    def _run(self) -> None:
        try:
            while not self._ends:
                batch, over = self._tail.next()
                if batch:
                    self._add(batch)
                if over:
                    break
        except BaseException as error:  # told by the server, in its own thread
            self.failure = error
        self.over = True

    def _add(self, batch: Batch) -> None:
        with self._lock:
            if len(batch.rows):
                thinned = self._stream.thin(batch.sequence, batch.rows)
                self._rows.add(thinned, thinned.size)
            self._stream.events(batch.numbers, batch.events)
            if events := self._messages(self._events_out.read()):
                self._events.add(events, len(events))

    def _messages(self, data: bytes | None) -> bytes:
        """A stream's new messages; only its first part has a header. None: there are none."""
        if data is None:
            return b""
        return strip(data) if data[:4] == self._start[:4] else data
