"""Dialogues with the controller that take several cycles, as generators: each `yield` waits for the next call.

`open` runs them to their end and sleeps in between; the loop advances them by one step per cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

T = TypeVar("T")
Steps = Generator[None, None, T]
Clock = Callable[[], int]  # ns


def until(done: Callable[[], bool], clock: Clock, seconds: float) -> Steps[bool]:
    """Waits until `done`; returns False if that took longer than `seconds`."""
    deadline = clock() + round(seconds * 1e9)
    while not done():
        if clock() > deadline:
            return False
        yield
    return True


def pause(clock: Clock, seconds: float) -> Steps[None]:
    """Waits for `seconds`."""
    yield from until(lambda: False, clock, seconds)
