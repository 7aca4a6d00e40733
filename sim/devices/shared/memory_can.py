"""A CAN bus in memory, for a fake that is the driver itself on simulated drives: same link, no wire, no time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import can

from drivers.canbus import MOST, CanLink
from runtime.contracts.errors import DeviceLostError


class MemoryCan(CanLink):
    """See `CanLink`. A frame is obeyed when it is written; its answers are there for the next `read`."""

    def __init__(self, place: str, obey: Callable[[can.Message], list[can.Message]]) -> None:
        super().__init__("memory", place, None, "virtual")
        self._obey = obey
        self._waiting: deque[can.Message] = deque(maxlen=MOST)
        self._closed = False

    def read(self) -> list[can.Message]:
        """See `CanLink.read`."""
        self._check()
        found = list(self._waiting)
        self._waiting.clear()
        return found

    def read_wait(self, timeout_s: float) -> list[can.Message]:
        """See `CanLink.read_wait`; nothing comes by waiting."""
        return self.read()

    def write(self, message: can.Message) -> bool:
        """See `CanLink.write`."""
        self._check()
        self._waiting.extend(self._obey(message))
        return True

    def close(self) -> None:
        """See `CanLink.close`."""
        self._closed = True

    def _check(self) -> None:
        if self._closed:
            raise DeviceLostError(self.place, "the bus in memory is closed", "Open it first")
