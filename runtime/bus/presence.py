"""Whether an instance's bus is there, as a client knows it without asking: its liveliness token."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh


class Presence:
    """Follows one liveliness token, on a zenoh thread.

    The token goes at once when the bus or its connection ends. A bus that hangs, or whose network is cut, loses it
    after zenoh's lease of 10 s.

    Attributes:
        comings: how many times the token has come: a bus that came again may be that of another run.
    """

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.comings = 0
        self._came = threading.Event()
        self._gone: float | None = None  # CLOCK_MONOTONIC s
        self._subscriber = subscribe(session, key, self._hear)

    def _hear(self, there: bool) -> None:
        if there:
            self.comings += 1
            self._gone = None
            self._came.set()
        else:
            self._gone = time.monotonic()

    def wait(self, timeout: float) -> bool:
        """Waits until the token comes for the first time, `timeout` s at most. Returns whether it came."""
        return self._came.wait(timeout)

    @property
    def there(self) -> bool:
        """Whether the bus is there now."""
        return self._came.is_set() and self._gone is None

    @property
    def missing(self) -> float:
        """Seconds since the bus has gone; 0 while it is there."""
        gone = self._gone
        return 0.0 if gone is None else time.monotonic() - gone


def subscribe(session: zenoh.Session, key: str, callback: Callable[[bool], None]) -> zenoh.Subscriber[None]:
    """Calls `callback`, on a zenoh thread, with True when the token of `key` is there or comes, False when it goes."""
    return session.liveliness().declare_subscriber(
        key, lambda sample: callback(sample.kind == zenoh.SampleKind.PUT), history=True
    )
