"""The twin of CubeMars AK actuators in servo mode: simulated drives with the real protocol on a CAN bus."""

from __future__ import annotations

from srl.sim.devices.cubemars_servo.fake import FakeCubemarsServo
from srl.sim.devices.cubemars_servo.firmware import ServoNode
from srl.sim.devices.shared.can_drives import DrivesTwin


class CubemarsServoTwin(DrivesTwin):
    """See `DrivesTwin`. It obeys a frame that sets the origin, as the actuator does; the driver never sends one."""

    nodes: list[ServoNode]  # type: ignore[assignment]

    def __init__(self, fake: FakeCubemarsServo) -> None:
        super().__init__(fake)
