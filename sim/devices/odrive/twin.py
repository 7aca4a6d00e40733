"""The twin of ODrives: simulated axes with the real protocol on a CAN bus."""

from __future__ import annotations

from srl.sim.devices.odrive.fake import FakeOdrive
from srl.sim.devices.odrive.firmware import OdriveNode
from srl.sim.devices.shared.can_drives import DrivesTwin


class OdriveTwin(DrivesTwin):
    """See `DrivesTwin`. With firmware 0.6 it answers requests with the id 63, too, as the maker's scan needs it."""

    nodes: list[OdriveNode]  # type: ignore[assignment]

    def __init__(self, fake: FakeOdrive) -> None:
        super().__init__(fake)
