"""A sensor of numbers on a serial line, in a simulated world."""

from __future__ import annotations

from srl.drivers.serial_lines import SerialLines, SerialLinesConfig
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.numbers import FakeNumbers, FakeNumbersOptions


class FakeSerialLines(FakeNumbers):
    """See `FakeNumbers`."""

    real = SerialLines

    def __init__(self, name: str, config: SerialLinesConfig, world: World, options: FakeNumbersOptions) -> None:
        super().__init__(name, config, world, options)
        self.lines = config
        self.states = config.states()
