"""A peer that goes on by itself while the test's own thread waits for it."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def repeating(turn: Callable[[], object], pause: float) -> Iterator[None]:
    """Calls `turn` again and again in a thread meanwhile, with `pause` s after each call."""
    over = threading.Event()

    def run() -> None:
        while not over.is_set():
            turn()
            time.sleep(pause)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
