"""What every device must do, whatever its wire: the rules that device authors get, put to all registered drivers."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.peer import bound, make

from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.world import Fake, World
from srl.sim.devices.examples import DEVICES
from srl.testing import DriverConformance, TwinBench

OWN = [name for name in registry.names("drivers") if name not in ("replay", "lever")]  # a recording is no wire


def test_every_registered_device_is_known_here() -> None:
    assert set(OWN) == set(DEVICES)
    assert set(registry.names("fakes")) >= set(OWN)
    assert set(registry.names("twins")) >= set(OWN)


class TestOurs(DriverConformance):
    """Each device as `srl.sim.devices.examples` has it, instead of as a profile has it."""

    kind: str

    @pytest.fixture(autouse=True, params=OWN)
    def _each(self, request: pytest.FixtureRequest) -> None:
        self.kind = request.param
        self.only_changes = self.kind == "gamepad"

    def driver(self, port: str = "") -> Driver:
        config, _, _, nobody = DEVICES[self.kind]
        port = port or nobody
        cls = registry.load("drivers", self.kind, "test")
        made: Driver = bound(cls("device", cls.Config.model_validate({"port": port} | config)))
        return made

    def bench(self) -> TwinBench:
        if self.kind in ("base", "lsl", "zenoh"):
            pytest.skip("a process behind the link has a clock of its own")
        config, options, world, port = DEVICES[self.kind]
        order: dict[str, Any] = {"driver": self.kind, "config": {"port": port} | config, "options": options}
        return TwinBench.of(make(order | {"world": world, "seed": 3})[2])

    def simulated(self) -> tuple[World, Fake]:
        config, options, world, port = DEVICES[self.kind]
        order: dict[str, Any] = {"driver": self.kind, "config": {"port": port} | config, "options": options}
        made, fake, _ = make(order | {"world": world, "seed": 3})
        return made, fake
