"""A base's twin that runs in a thread, and a driver for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from helpers.zenoh import Served, bound, cycles
from srl.drivers.base import BaseConfig, MobileBase
from srl.drivers.base.driver import COMMAND
from srl.sim.devices.base.fake import FakeBase, FakeBaseOptions
from srl.sim.devices.base.twin import BaseTwin
from srl.sim.world.cell import Cell, CellConfig


class Robot:
    """A twin that runs, and a driver for it."""

    def __init__(self, options: dict[str, Any], robot: dict[str, Any], sim: dict[str, Any]) -> None:
        world = Cell(CellConfig(parts={"base": {"part": "summit-xl"}}), 0)
        config = BaseConfig(port="tcp://127.0.0.1:1", **(options | robot))
        self.fake = FakeBase("base", config, world, FakeBaseOptions(**sim))
        bound(self.fake)
        self.twin = BaseTwin(self.fake)
        self.twin.keep_log = True
        self.served = Served(world, self.twin)
        self.base = MobileBase("base", BaseConfig(port=self.twin.address, **options))
        bound(self.base)
        self.command = self.base.command_arrays[COMMAND]

    def speed(self) -> float:
        return float(np.abs(self.served.do(self.fake.base.twist)).max())

    def drive(self, vx: float = 0.3) -> None:
        """Until it moves as told."""
        self.command[:] = vx, 0.0, 0.1
        cycles(self.base, lambda: abs(self.base.state_arrays["twist"][0] - vx) < 0.02, "motion", write=True)


@contextmanager
def robot(robot: dict[str, Any] | None = None, sim: dict[str, Any] | None = None, **options: Any) -> Iterator[Robot]:
    """`robot`: where the twin's options differ from the driver's."""
    made = Robot(options, robot or {}, sim or {})
    with made.served:
        try:
            yield made
        finally:
            made.base.close()
