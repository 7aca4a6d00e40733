"""Windows of world time in a fake's options, and what fakes do while their device is gone."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from runtime.contracts.errors import DeviceError, WiringError
from runtime.contracts.world import World

Windows = tuple[tuple[float, float], ...]


def rising(windows: Windows) -> Windows:
    """Raises `ValueError` for windows that end before they begin, or begin before the previous one has ended."""
    times = [t for window in windows for t in window]
    if any(a >= b for a, b in pairwise(times)):
        raise ValueError("the times must rise: [[from, to], [from, to], ...]")
    return windows


def inside(windows: Windows, at: int) -> bool:
    """Whether `at` (ns) lies in one of the windows (s)."""
    return bool(windows) and any(start <= at * 1e-9 < end for start, end in windows)


def refuse_while_gone(name: str, loss: Windows, at: int) -> None:
    """Raises `DeviceError` while the device is gone."""
    if inside(loss, at):
        raise DeviceError(name, "the simulated device doesn't answer", "It comes back at the end of its 'loss' window")


def require(world: World, method: str, name: str) -> Any:
    """Returns the world if it has `method`.

    Raises:
        WiringError: it has not.
    """
    if not hasattr(world, method):
        raise WiringError(
            f"sim.devices.{name}",
            f"the world {type(world).__name__} has no '{method}' for this fake",
            "Choose a world that has, such as augmented-hand",
        )
    return world
