"""CubeMars AK actuators in servo mode in the simulated world."""

from __future__ import annotations

from drivers.cubemars_servo import CubemarsServo
from drivers.cubemars_servo.config import CubemarsServoConfig
from runtime.contracts.errors import WiringError
from sim.devices.cubemars_servo.firmware import ServoNode
from sim.devices.shared.can_drives import FakeDrives


class FakeCubemarsServo(FakeDrives):
    """See `FakeDrives`."""

    real = CubemarsServo
    nodes: list[ServoNode]  # type: ignore[assignment]

    def node(self, k: int, i: int) -> ServoNode:
        config = self.config
        assert isinstance(config, CubemarsServoConfig)
        axis = list(config.axes.values())[k]
        if self.chain.models[i].name != axis.model:
            raise WiringError(
                f"sim.parts.{self.chain.name}.axes.{self.chain.names[i]}.model",
                f"it is an {self.chain.models[i].name}, devices.{self.name} says {axis.model}",
                "Make them agree",
            )
        return ServoNode(self.chain, i, axis, config)
