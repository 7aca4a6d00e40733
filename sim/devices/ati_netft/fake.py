"""An ATI Net F/T sensor in the simulated world."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from srl.drivers.ati_netft import AtiNetFt
from srl.drivers.ati_netft.config import AtiNetFtConfig
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.force_torque import ForceTorqueFake, ForceTorqueOptions

COUNTS = 1_000_000  # per N and per N m, the usual values


class FakeAtiNetFtOptions(ForceTorqueOptions):
    """Options of the fake."""

    rate: float = Field(default=1000.0, gt=0, le=4000, description="Hz, samples it takes and records it sends")
    delay: float = Field(default=0.001, ge=0, le=0.5, description="s, from sampling to arrival")
    product: str = Field(default="Ethernet Axia", description="name it tells; 'Axia' decides on its status words")
    host: str = Field(default="127.0.0.1", description="loopback address that the twin listens on")
    port: int = Field(default=0, ge=0, le=65535, description="its UDP port, 49152 on a sensor; 0: any that is free")
    http: int = Field(default=0, ge=0, le=65535, description="its web page's port, 80 on a sensor; 0: any")
    tcp: int = Field(default=0, ge=0, le=65535, description="its commands' port, 49151 on a sensor; 0: any")


class FakeAtiNetFt(ForceTorqueFake):
    """See `ForceTorqueFake`; the resolution is one count."""

    Options = FakeAtiNetFtOptions
    real = AtiNetFt
    options: FakeAtiNetFtOptions

    def __init__(self, name: str, config: AtiNetFtConfig, world: World, options: FakeAtiNetFtOptions) -> None:
        super().__init__(name, config, world, options)
        self._biases = config.bias

    def open(self) -> None:
        first = not self.health.was_open
        super().open()
        if self._biases and first:
            self.bias()

    def quantise(self, values: Array) -> Array:
        values *= COUNTS
        np.rint(values, out=values)
        values /= COUNTS
        return values
