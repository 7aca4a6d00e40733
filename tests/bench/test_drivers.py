"""The bench of the drivers: how the other side goes on while a driver opens."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from helpers.wait import until

from bench.drivers import served

MS = 1_000_000


def test_while_a_driver_opens_its_world_goes_on_and_no_faster_than_the_clock() -> None:
    """A rate that the driver measures meanwhile would be too high, and all that comes later would seem late."""
    world: Any = SimpleNamespace(time=5 * MS)
    twin: Any = SimpleNamespace(service=lambda now: None)
    world.advance = lambda to: setattr(world, "time", to)
    started = time.monotonic_ns()
    served(world, twin, lambda: until(lambda: world.time > 50 * MS))
    assert world.time - 5 * MS <= time.monotonic_ns() - started
