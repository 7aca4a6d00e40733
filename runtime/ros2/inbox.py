"""What peers ask, for two threads: a stop waits for nothing else, and what came before it isn't done after it."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

MOST: Final = 16  # requests that wait; more are dropped, as zenoh's own threads may never be held up


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
        self._stops: queue.Queue[tuple[Work, Item] | None] = queue.Queue(MOST)
        self._others: queue.Queue[tuple[Work, Item] | None] = queue.Queue(2 * MOST)
        self._newest: dict[Work, Item] = {}
        self._lock = threading.Lock()
        self._threads = [
            threading.Thread(target=self._serve, args=(q,), daemon=True) for q in (self._stops, self._others)
        ]
        for thread in self._threads:
            thread.start()

    def stops(self, work: Work) -> Callable[[Any], None]:
        """A callback that hands over a stop."""

        def arrive(what: Any) -> None:
            self.stopped = time.monotonic_ns()
            self._put(self._stops, work, Item(what, self.stopped))

        return arrive

    def requests(self, work: Work) -> Callable[[Any], None]:
        """A callback that hands over a request, in order; beyond MOST it is dropped."""

        def arrive(what: Any) -> None:
            if self._others.qsize() < MOST:
                self._put(self._others, work, Item(what, time.monotonic_ns()))

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
            if not waits and not self._put(self._others, once, item):
                with self._lock:
                    self._newest.pop(work, None)

        return arrive

    def overtaken(self, item: Item) -> bool:
        """Whether a stop has come since."""
        return item.came <= self.stopped

    @staticmethod
    def _put(to: queue.Queue[tuple[Work, Item] | None], work: Work, item: Item) -> bool:
        try:
            to.put_nowait((work, item))
        except queue.Full:
            return False
        return True

    @staticmethod
    def _serve(of: queue.Queue[tuple[Work, Item] | None]) -> None:
        while (given := of.get()) is not None:
            work, item = given
            try:
                work(item)
            except Exception as error:
                print(f"ros2: {type(error).__name__}: {error}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the threads, after what they are at."""
        for q, thread in zip((self._stops, self._others), self._threads, strict=True):
            while thread.is_alive():
                try:
                    q.put(None, timeout=0.1)
                    break
                except queue.Full:
                    continue
            thread.join(timeout=5.0)
