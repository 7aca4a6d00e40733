"""What arrives on zenoh's threads, queued for the bus's one thread. Stops come first and always find room.

Who may only read comes last, in a queue of its own: a flood of reading takes no room from those who command.
"""

from __future__ import annotations

import json
import queue
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

QUERIES = 1024  # queries that may wait
ASIDE = 32  # queries of those who only read that are handled in one turn
SAMPLES = 64  # items that may wait when a sample arrives, and items handled in one turn: more would delay a stop


class _Item(NamedTuple):
    """One arrival: the work to do, what with, and when it came (CLOCK_MONOTONIC ns)."""

    work: Callable[[Any], None]
    what: Any
    came: int


def came(when: int) -> bytes:
    """The attachment of a request that somebody passes on: when it came to them, CLOCK_MONOTONIC ns."""
    return when.to_bytes(8, "little", signed=True)


def came_of(what: Any, otherwise: int) -> int:
    """When a query came to who passes it on, by its attachment; `otherwise` without one."""
    given = getattr(what, "attachment", None)
    content = b"" if given is None else given.to_bytes()
    return int.from_bytes(content, "little", signed=True) if len(content) == 8 else otherwise


def from_sender(name: str) -> bytes:
    """The attachment of a parameter's change: what its sender calls itself."""
    return json.dumps({"from": name}).encode()


def sender_of(query: zenoh.Query) -> str:
    """What the sender of a parameter's change calls itself; "" if it doesn't say."""
    try:
        content = json.loads(b"" if query.attachment is None else query.attachment.to_bytes())
    except (ValueError, RecursionError):
        return ""
    name = content.get("from") if isinstance(content, dict) else None
    return name if isinstance(name, str) else ""


class Arrivals:
    """The queues; see the module's docstring.

    Attributes:
        overtaken: True while an item is handled that came before a stop which was handled already.
    """

    def __init__(self) -> None:
        self.overtaken = False
        self._items: queue.SimpleQueue[_Item] = queue.SimpleQueue()
        self._stops: queue.SimpleQueue[_Item] = queue.SimpleQueue()
        self._asides: queue.SimpleQueue[_Item] = queue.SimpleQueue()
        self._stopped = 0  # when the newest stop came

    def into(
        self, work: Callable[[Any], None], unless: Callable[[Any], bool] = lambda _: False, aside: bool = False
    ) -> Callable[[Any], None]:
        """Returns a callback for zenoh's threads that queues its argument for `work`.

        Queries for which `unless` is true are for others, and dropped at once: nobody waits for this queue with them.
        `aside`: they are of those who only read.
        """

        def arrive(what: Any) -> None:
            if unless(what):
                what.drop()
                return
            # The queue must not grow without bounds, and a flood of setpoints must leave room for queries.
            asked = isinstance(what, zenoh.Query)
            now = time.monotonic_ns()
            if aside:
                first = self._asides.empty()
                if self._asides.qsize() < QUERIES:
                    self._asides.put(_Item(work, what, time.monotonic_ns()))
                else:
                    what.drop()
                if first:
                    self.wake()
            elif self._items.qsize() < (QUERIES if asked else SAMPLES):
                self._items.put(_Item(work, what, min(now, came_of(what, now))))
            elif asked:
                what.drop()

        return arrive

    def into_stops(self, work: Callable[[Any], None], key: str) -> Callable[[Any], None]:
        """As `into`, for stops: queries for exactly this key. One by wildcard stops nothing: it takes no room."""
        ordinary = self.into(work)

        def arrive(what: Any) -> None:
            if str(what.key_expr) != key:
                ordinary(what)
                return
            if self._stops.qsize() >= QUERIES:
                what.drop()  # so many stops wait already
                return
            self._stopped = time.monotonic_ns()
            self._stops.put(_Item(work, what, self._stopped))
            self.wake()

        return arrive

    def wake(self) -> None:
        """Ends a wait. A signal's handler may call it, and must.

        `SimpleQueue.get` computes what is left of its timeout after a handler has run. If nothing is left, CPython 3.11
        waits without end.
        """
        self._items.put(_Item(lambda _: None, None, time.monotonic_ns()))

    def handle(self, timeout: float) -> None:
        """Waits until something arrives or `timeout` (s) is over, then handles what is there, at most one turn's."""
        try:
            self._handle(self._items.get(timeout=timeout))
            for _ in range(SAMPLES):
                self._handle(self._items.get_nowait())
        except queue.Empty:
            pass
        for _ in range(min(ASIDE, self._asides.qsize())):
            self._handle(self._asides.get_nowait())

    def _handle(self, item: _Item) -> None:
        while not self._stops.empty():
            self._do(self._stops.get_nowait())
        self.overtaken = item.came < self._stopped
        self._do(item)

    @staticmethod
    def _do(item: _Item) -> None:
        try:
            item.work(item.what)
        except Exception:
            print("bus: a client's request failed:", file=sys.stderr)
            traceback.print_exc()
