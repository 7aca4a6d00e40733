"""CubeMars AK actuators in servo mode in the simulated world."""

from __future__ import annotations

from srl.drivers.cubemars_servo import CubemarsServo
from srl.drivers.cubemars_servo.config import CubemarsServoConfig
from srl.runtime.contracts.errors import WiringError
from srl.sim.devices.cubemars_servo.firmware import ServoNode
from srl.sim.devices.shared.can_drives import FakeDrives


class FakeCubemarsServo(FakeDrives):
    """See `FakeDrives`."""

    real = CubemarsServo
    config: CubemarsServoConfig
    nodes: list[ServoNode]  # type: ignore[assignment]

    def node(self, k: int, i: int) -> ServoNode:
        axis = list(self.config.axes.values())[k]
        if self.chain.models[i].name != axis.model:
            raise WiringError(
                f"sim.parts.{self.chain.name}.axes.{self.chain.names[i]}.model",
                f"it is an {self.chain.models[i].name}, devices.{self.name} says {axis.model}",
                "Make them agree",
            )
        return ServoNode(self.chain, i, axis, self.config)
