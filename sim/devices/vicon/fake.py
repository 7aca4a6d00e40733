"""A Vicon system that observes a simulated cell."""

from __future__ import annotations

from pydantic import Field

from srl.drivers.vicon import Vicon
from srl.drivers.vicon.config import ViconConfig
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.cameras import Cameras, CamerasConfig


class FakeViconConfig(CamerasConfig):
    """Options of the fake."""

    y_up: bool = Field(default=False, description="the twin's server has its y axis up")


class FakeVicon(Cameras):
    """See `Cameras`; the delay is sent as the server's latency."""

    Options = FakeViconConfig
    real = Vicon

    def __init__(self, name: str, config: ViconConfig, world: World, options: FakeViconConfig) -> None:
        super().__init__(name, config, world, options)
        self.vicon, self.server = config, options

    def open(self) -> None:
        super().open()
        rate, needed = self.seen_by.rate, self.vicon.rate
        if rate < needed * 0.999:
            self.close()
            raise DeviceError(
                self.name,
                f"the simulated server captures {rate:g} frames a second, the profile needs {needed:g}",
                f"Set 'sim.devices.{self.name}.rate' or the device's 'rate'",
            )
