"""ODrives in the simulated world."""

from __future__ import annotations

from srl.drivers.odrive import Odrive
from srl.drivers.odrive.config import OdriveConfig
from srl.runtime.contracts.errors import WiringError
from srl.sim.devices.odrive.firmware import OdriveNode
from srl.sim.devices.shared.can_drives import FakeDrives


class FakeOdrive(FakeDrives):
    """See `FakeDrives`."""

    real = Odrive
    config: OdriveConfig
    nodes: list[OdriveNode]  # type: ignore[assignment]

    def node(self, k: int, i: int) -> OdriveNode:
        axis, gear = list(self.config.axes.values())[k], self.chain.motors.models[i].gear
        if axis.gear != gear:
            raise WiringError(
                f"sim.parts.{self.chain.name}.axes.{self.chain.names[i]}.model",
                f"its gear is {gear:g}, devices.{self.name} says {axis.gear:g}",
                "Make them agree",
            )
        found = OdriveNode(self.chain, i, axis, self.config)
        if (endpoints := self.config.numbers()) is not None:
            found.fits(endpoints)
        return found
