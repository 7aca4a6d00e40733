"""What peers ask, in lanes of a thread each: a stop waits for nothing else, a cancellation and a command for no reader.

What came before a stop isn't done after it.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum
from typing import Any, Final, NamedTuple

MOST: Final = 16  # requests that wait; more are dropped, as zenoh's own threads may never be held up


TOLD: Final = 1_000_000_000  # ns between two lines about errors
LONGEST_LINE: Final = 300  # characters, as the text may be a peer's


class Lane(Enum):
    """What waits for what: requests of one lane for each other."""

    STOPS = "stops"
    CANCELS = "cancels"
    COMMANDS = "commands"
    RESULTS = "results"
    PARAMETERS = "parameters"


class Item(NamedTuple):
    """What came, and when (CLOCK_MONOTONIC ns)."""

    what: Any
    came: int


Work = Callable[[Item], None]


class Inbox:
    """The queues; see the module's docstring.

    Attributes:
        stopped: CLOCK_MONOTONIC ns, when the newest stop came.
    """

    def __init__(self) -> None:
        self.stopped = 0
        # Setpoints and trajectories are commands, too, and need room beside requests.
        self._queues: dict[Lane, queue.Queue[tuple[Work, Item] | None]] = {lane: queue.Queue(2 * MOST) for lane in Lane}
        self._newest: dict[Work, Item] = {}
        self._lock = threading.Lock()
        self._told = 0
        self._threads = {
            lane: threading.Thread(target=self._serve, args=(q,), daemon=True) for lane, q in self._queues.items()
        }
        for thread in self._threads.values():
            thread.start()

    def stops(self, work: Work) -> Callable[[Any], None]:
        """A callback that hands over a stop."""

        def arrive(what: Any) -> None:
            self.stopped = time.monotonic_ns()
            self._put(Lane.STOPS, work, Item(what, self.stopped))

        return arrive

    def requests(self, work: Work, lane: Lane = Lane.COMMANDS) -> Callable[[Any], None]:
        """A callback that hands over a request, in order; beyond MOST of the lane it is dropped."""

        def arrive(what: Any) -> None:
            if self._queues[lane].qsize() < MOST:
                self._put(lane, work, Item(what, time.monotonic_ns()))

        return arrive

    def newest(self, work: Work) -> Callable[[Any], None]:
        """A callback that hands over the newest alone; one that waits is replaced."""

        def once(_: Item) -> None:
            with self._lock:
                item = self._newest.pop(work)
            work(item)

        def arrive(what: Any) -> None:
            item = Item(what, time.monotonic_ns())
            with self._lock:
                waits = work in self._newest
                self._newest[work] = item
            if not waits and not self._put(Lane.COMMANDS, once, item):
                with self._lock:
                    self._newest.pop(work, None)

        return arrive

    def overtaken(self, item: Item) -> bool:
        """Whether a stop has come since."""
        return item.came <= self.stopped

    def _put(self, lane: Lane, work: Work, item: Item) -> bool:
        try:
            self._queues[lane].put_nowait((work, item))
        except queue.Full:
            return False
        return True

    def _serve(self, of: queue.Queue[tuple[Work, Item] | None]) -> None:
        while (given := of.get()) is not None:
            work, item = given
            try:
                work(item)
            except Exception as error:
                if (now := time.monotonic_ns()) >= self._told:
                    self._told = now + TOLD
                    print(f"ros2: {type(error).__name__}: {error}"[:LONGEST_LINE], file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the threads, after what they are at."""
        for lane, thread in self._threads.items():
            while thread.is_alive():
                try:
                    self._queues[lane].put(None, timeout=0.1)
                    break
                except queue.Full:
                    continue
            thread.join(timeout=5.0)
