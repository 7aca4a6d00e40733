"""Which ports of a profile are paths of this machine, and which devices share one."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from srl.runtime.contracts.driver import Driver


def local_path(port: str) -> str | None:
    """The path that a profile's `port` is; None if it is an address (tcp://...) or a word (auto)."""
    if port.startswith("spy:"):
        port = port.split(":", 2)[-1]
    return port if "/" in port and "://" not in port else None


def shared(devices: Sequence[Driver]) -> Iterator[tuple[str, str]]:
    """Pairs of devices at one path, by whatever names: the later one first. Nothing is opened."""
    owners: dict[str, str] = {}
    for device in devices:
        port = getattr(device.config, "port", None)
        path = local_path(port) if isinstance(port, str) else None
        if path is not None:
            owner = owners.setdefault(os.path.realpath(path), device.name)
            if owner != device.name:
                yield device.name, owner
