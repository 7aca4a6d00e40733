"""What became of requests, as events for people: what was granted, and what was refused, at most once a second."""

from __future__ import annotations

from collections.abc import Callable

from srl.runtime.ipc.header import Origin
from srl.runtime.ipc.requests import Answer, RequestKind

EVERY = 1_000_000_000  # ns between two events about refusals


def described(kind: RequestKind, origin: Origin, uid: int) -> str:
    """A request in words: "reset (local, user 1000)"."""
    return f"{kind.name.lower()} ({origin.name.lower()}" + (f", user {uid})" if uid >= 0 else ")")


class Refusals:
    """Counts refusals and reports them."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._count, self._last, self._next = 0, "", 0

    def add(self, count: int, what: str) -> None:
        """Adds `count` refusals; `what` describes the last of them."""
        self._count += count
        self._last = what

    def turn(self, now: int) -> None:
        """Reports what was added, if an event is due. Called once a cycle; `now` in ns."""
        if self._count and now >= self._next:
            self._report(f"refused: {self._last}" + (f"; {self._count} since the last such event" * (self._count > 1)))
            self._count, self._next = 0, now + EVERY


def refusal(kind: RequestKind, origin: Origin, uid: int, answer: Answer) -> str:
    """A refused request in words: "reset (bus): refused_latch"."""
    return f"{described(kind, origin, uid)}: {answer.name.lower()}"
