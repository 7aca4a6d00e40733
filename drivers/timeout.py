"""How long `open` still waits for an answer."""

from __future__ import annotations

import time
from collections.abc import Iterator


def remaining(seconds: float) -> Iterator[float]:
    """Yields the s that are left of a time which begins now, and ends when none are. Blocks nothing itself."""
    deadline = time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0:
        yield left
