"""A run's topics as they are now, for all who look: each is encoded once a picture, and only where it is asked for."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.layout import Words
from srl.runtime.ipc.rows import Condition, Rows
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import cdr
from srl.runtime.ros2.topics import Topic, Topics

RATE: Final = 30.0  # Hz, at most, of pictures
KEPT: Final = 256  # events for those who come later


class Feed:
    """Follows one run.

    Attributes:
        name: of the run.
        session: tells the app one run of the loop from the next.
        channels: what is advertised, each with its index as its id.
        number: of the newest picture; 0 before the first.
        stamp: of its row, Unix ns; 0 before the first.
        first: Unix ns, of what never changes.
        generation: grows with each new layout.
        picture: gives a channel's payload of that row; None: the row has none.
    """

    number: int
    stamp: int
    picture: Callable[[int], bytes | None]

    def __init__(self, run: RunFolder) -> None:
        """Raises RecordingError: there is no run here."""
        self._folder, self._rows = run, Rows(run)
        self.generation = 0
        self._due = 0.0
        self._events: EventReader | None = None
        self._load()

    def look(self, now: float) -> bool:
        """Takes new rows and events. Returns whether there is a new picture or event. `now`: CLOCK_MONOTONIC s."""
        if now < self._due:
            return False
        self._due = max(self._due + 1 / RATE, now)
        rows = self._rows.take(now)
        if self._rows.layout is not self._layout:
            self._load()
        fresh = self._take_events()
        if len(rows):
            self.number += 1
            self.stamp = self._at(rows[-1])
            self.picture = self._pictured(rows[-1], self.stamp)
        return fresh or bool(len(rows))

    def condition(self, now: float) -> tuple[Condition, str]:
        """How the run is, and the words for people; empty if it is well. `now`: CLOCK_MONOTONIC s."""
        return self._rows.condition(now)

    def kept(self, channel: int) -> bytes | None:
        """The only message of a topic that has one."""
        return self._topics.all[channel].kept

    def is_events(self, channel: int) -> bool:
        """Whether a channel is that of the events."""
        return self._topics.all[channel].name == "/rosout"

    def events_since(self, number: int) -> tuple[list[tuple[int, bytes]], int]:
        """Stamps and payloads of the events from a number on, as far as they are kept, and the next number."""
        first = self._count - len(self._log)
        return list(self._log)[max(number - first, 0) :], self._count

    def close(self) -> None:
        """Unmaps the rows."""
        self._rows.close()
        if self._events is not None:
            self._events.close()

    def _load(self) -> None:
        layout = self._layout = self._rows.layout
        self.generation += 1
        self.name, self.session = str(layout.meta.get("name", "")), secrets.token_hex(8)
        self._wall = int(layout.meta.get("wall", 0))
        self.first = self._wall + time.monotonic_ns()
        self._topics = Topics(layout, self.first)
        self.channels = [_channel(i, topic) for i, topic in enumerate(self._topics.all)]
        self.number = self.stamp = 0
        self.picture = lambda _: None
        self._log: deque[tuple[int, bytes]] = deque(maxlen=KEPT)
        self._count = 0
        if self._events is not None:
            self._events.close()
        try:
            self._events = EventReader(self._folder.events)
        except RecordingError:
            self._events = None

    def _take_events(self) -> bool:
        found = self._events.take() if self._events is not None else []
        for event in found:
            stamp = event.time + self._wall
            self._log.append((stamp, self._topics.event(event, stamp)[1]))
        self._count += len(found)
        return bool(found)

    def _at(self, row: Words) -> int:
        return int(self._layout.header(row, "now")) + self._wall

    def _pictured(self, row: Words, stamp: int) -> Callable[[int], bytes | None]:
        """`picture` of a row (width,): a payload is made when it is asked for first."""
        topics = self._topics
        own = row.copy()  # the ring goes on

        @cache
        def moving() -> dict[str, bytes]:
            return {topic.name: payload for topic, payload in topics.moving(own, stamp)}

        @cache
        def payload(channel: int) -> bytes | None:
            topic = topics.all[channel]
            if topic.encode is None:
                return moving().get(topic.name)
            return topic.encode(own[None], np.array([stamp]))[0].tobytes()

        return payload


def _channel(number: int, topic: Topic) -> dict[str, Any]:
    return {
        "id": number, "topic": topic.name, "encoding": "cdr", "schemaName": topic.kind, "schemaEncoding": "ros2msg",
        "schema": cdr.definition(topic.kind), "metadata": topic.about,
    }  # fmt: skip
