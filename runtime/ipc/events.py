"""Events: texts from the loop for people, in a second ring beside the rows, as the loop itself must not print.

Record (64 int64 words): CLOCK_MONOTONIC ns, level, cycle, then up to 488 bytes of UTF-8 text, zero-padded.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np

from srl.runtime.ipc.ring import RingReader, RingWriter

WIDTH = 64
CAPACITY = 1024
_TEXT = (WIDTH - 3) * 8


class Level(IntEnum):
    """The level of an event: a coarse subset of journald's priorities."""

    INFO = 6
    WARNING = 4
    ERROR = 3


@dataclass(slots=True)
class Event:
    """One event."""

    time: int
    level: Level
    cycle: int
    text: str


class EventWriter:
    """The loop's side of the events."""

    def __init__(self, path: Path) -> None:
        self._ring = RingWriter.create(path, WIDTH, CAPACITY)
        self._words = np.zeros(WIDTH, np.int64)
        self._bytes = self._words[3:].view(np.uint8)

    def write(self, time: int, level: Level, cycle: int, text: str) -> None:
        """Appends an event. A long text is cut."""
        content = text.encode(errors="replace")[:_TEXT]
        self._words[:3] = time, level, cycle
        self._bytes[:] = 0
        self._bytes[: len(content)] = np.frombuffer(content, np.uint8)
        self._ring.append(self._words)

    def close(self) -> None:
        """Unmaps the file."""
        self._ring.close()


class EventReader:
    """The side of any other process."""

    def __init__(self, path: Path, after: int = 0) -> None:
        self._ring = RingReader(path, after, width=WIDTH)

    @property
    def sequence(self) -> int:
        """Sequence number of the last event taken."""
        return self._ring.sequence

    @property
    def content(self) -> memoryview:
        """The whole file, as it is now."""
        return self._ring.content

    def take(self) -> list[Event]:
        """The events since the last call."""
        return [
            Event(int(r[0]), _level(int(r[1])), int(r[2]), r[3:].tobytes().rstrip(b"\0").decode(errors="replace"))
            for r in self._ring.take()
        ]

    def close(self) -> None:
        """Unmaps the file."""
        self._ring.close()


def _level(number: int) -> Level:
    """The level; a damaged record's text is still worth reading."""
    return Level(number) if number in set(Level) else Level.WARNING
