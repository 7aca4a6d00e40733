"""Windows of world time in a fake's options, and what fakes do while their device is gone."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator

from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.world import Fake, World
from srl.sim.world.cell import Cell

_Windows = tuple[tuple[float, float], ...]


def rising(windows: _Windows) -> _Windows:
    """Raises `ValueError` for windows that end before they begin, or begin before the previous one has ended."""
    times = [t for window in windows for t in window]
    if any(a >= b for a, b in pairwise(times)):
        raise ValueError("the times must rise: [[from, to], [from, to], ...]")
    return windows


Windows = Annotated[_Windows, AfterValidator(rising)]


def inside(windows: Windows, at: int) -> bool:
    """Whether `at` (ns) lies in one of the windows (s)."""
    return bool(windows) and any(start <= at * 1e-9 < end for start, end in windows)


class Plug:
    """The plug of a twin, which is out during the `loss` windows of its fake's options."""

    def __init__(self, fake: Fake) -> None:
        self._fake = fake
        self._windows: Windows = getattr(fake.options, "loss", ())
        self._out = False

    def follow(self, pull: Callable[[], None], put: Callable[[], None]) -> None:
        """Calls `pull` when a window of world time has begun, and `put` when it has ended."""
        out = inside(self._windows, self._fake.world.time)
        if out != self._out:
            self._out = out
            (pull if out else put)()


def refuse_while_gone(name: str, loss: Windows, at: int) -> None:
    """Raises `DeviceError` while the device is gone."""
    if inside(loss, at):
        raise DeviceError(name, "the simulated device doesn't answer", "It comes back at the end of its 'loss' window")


def lose_while_gone(fake: Fake, loss: Windows) -> None:
    """Raises `DeviceLostError` where the device isn't open, or is gone in one of the windows (s of world time)."""
    if fake.health.connected and not inside(loss, fake.world.time):
        return
    fake.health.connected = False
    raise DeviceLostError(fake.name, "the simulated device is gone", "It comes back at the end of its 'loss' window")


def require_cell(world: World, name: str) -> Cell:
    """Returns the world if it is a cell. Raises WiringError if it isn't."""
    if not isinstance(world, Cell):
        raise WiringError(
            f"sim.devices.{name}",
            f"the world {type(world).__name__} has no part for this fake",
            "Set 'world: cell' and list its parts",
        )
    return world
