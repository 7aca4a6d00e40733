"""Waiting for a condition instead of for some time; what never comes is said."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

TIMEOUT = 30.0  # s of real time: a machine under load is slow, and what hangs hangs for longer
PAUSE = 0.001  # s


def until(
    condition: Callable[[], T],
    step: Callable[[], object] | None = None,
    *,
    what: str | Callable[[], str] = "",
    timeout: float = TIMEOUT,
    pause: float = PAUSE,
) -> T:
    """Asks until the condition is true; fails if it isn't in time.

    Args:
        condition: asked first, and again after each step.
        step: what makes it come true: a driver's read, a twin's turn. Without one, something else does.
        what: is waited for; a function is asked at the end. Without it, the condition's own source is shown.
        timeout: s.
        pause: s after each step.
    Returns:
        What the condition gave.
    """
    end = time.monotonic() + timeout
    while not (found := condition()):
        if time.monotonic() > end:
            output = (what() if callable(what) else what) or _source(condition)
            raise AssertionError(f"not in {timeout:g} s: {output}")
        if step is not None:
            step()
        time.sleep(pause)
    return found


def _source(condition: Callable[[], object]) -> str:
    try:
        return " ".join(inspect.getsource(condition).split())
    except (OSError, TypeError):  # a bound method of something compiled, say
        return repr(condition)
