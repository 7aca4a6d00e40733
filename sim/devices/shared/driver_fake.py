"""A fake that is the driver itself, on a simulated link: all that the driver does is in every simulated run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World


class DriverFake(Fake):
    """Hands everything on to the driver. A subclass gives the driver its simulated link.

    Attributes:
        driver: the real driver.
    """

    real: ClassVar[type[Any]]
    driver: Driver

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config, world, options)
        self.driver = self.real(name, config)
        self.health, self.limits = self.driver.health, self.driver.limits

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self.driver.bind(states, commands)
        self.driver.sent_arrays = self.sent_arrays

    def open(self) -> None:
        self.driver.open()
        self.limits = self.driver.limits

    def read(self, now: int) -> None:
        self.driver.read(now)

    def write(self, now: int) -> None:
        self.driver.write(now)

    def stop(self, category: Stop) -> None:
        self.driver.stop(category)

    def close(self) -> None:
        self.driver.close()

    def recover(self, now: int) -> None:
        self.driver.recover(now)

    def metrics(self) -> dict[str, object]:
        return self.driver.metrics()
