"""A CAN bus in memory, for a fake that is the driver itself on simulated drives: same link, no wire, no time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import can

from srl.drivers.canbus import MOST, CanLink
from srl.runtime.contracts.errors import DeviceLostError


def _nothing(at_once: bool) -> list[can.Message]:
    return []


class MemoryCan(CanLink):
    """See `CanLink`. A frame is obeyed when it is written; its answers are there for the next `read`."""

    def __init__(
        self,
        place: str,
        obey: Callable[[can.Message], list[can.Message]],
        due: Callable[[bool], list[can.Message]] = _nothing,
        gone: Callable[[], bool] = lambda: False,
    ) -> None:
        """
        Args:
            place: the device's name for errors.
            obey: takes a frame of the host; returns the answers.
            due: returns what the drives send by themselves; given True, as if their time had come.
            gone: whether the bus is gone: nothing comes or goes.
        """
        super().__init__("memory", place, None, "virtual")
        self._obey, self._due, self._gone = obey, due, gone
        self._waiting: deque[can.Message] = deque(maxlen=MOST)
        self._closed = False

    def read(self) -> list[can.Message]:
        self._check()
        found = [] if self._gone() else [*self._waiting, *self._due(False)]
        self._waiting.clear()
        return found

    def read_wait(self, timeout_s: float) -> list[can.Message]:
        """The world stands still meanwhile: the drives speak at once."""
        if not self._waiting:
            self._waiting.extend(self._due(True))
        return self.read()

    def write(self, message: can.Message) -> bool:
        self._check()
        if not self._gone():
            self._waiting.extend(self._obey(message))
        return True

    def close(self) -> None:
        self._closed = True

    def _check(self) -> None:
        if self._closed:
            raise DeviceLostError(self.place, "the bus in memory is closed", "Open it first")
