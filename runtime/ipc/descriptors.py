"""How many descriptors this process may have: servers take as many as they are allowed, as others may fill them."""

from __future__ import annotations

import contextlib
import resource


def raise_limit() -> int:
    """Raises the soft limit to the hard one. Returns what holds now."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return soft if soft != resource.RLIM_INFINITY else 1 << 20
