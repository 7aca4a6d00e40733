"""The twin of MIT-mode actuators: the simulated drives on a CAN bus of python-can."""

from __future__ import annotations

import can

from srl.sim.devices.mit_can.fake import FakeMitCan
from srl.sim.devices.shared.can import CanTwin


class MitCanTwin(CanTwin):
    """See `CanTwin` and `Drives`."""

    def __init__(self, fake: FakeMitCan) -> None:
        super().__init__(fake)
        self.actuators = fake
        self._loss = ()  # the fake's windows take the drives' power
        self.drives = fake.drives

    def power_up(self) -> None:
        """Nothing happens to the drives when their bus appears."""

    def take(self, message: can.Message, now: int) -> None:
        answers = self.drives.take(message.arbitration_id, bytes(message.data), bool(message.is_extended_id))
        for id, data, extended in answers:
            self.send(id, data, extended)

    def service(self, now: int) -> None:
        self.drives = self.actuators.follow()
        super().service(now)

    def metrics(self) -> dict[str, object]:
        """Adds frames by what they are, refused ones, and who is enabled."""
        drives = self.drives
        on = [bool(drives.motors.torque[i]) for i in drives.numbers]
        return {"frames": dict(drives.seen), "refused": dict(drives.refused), "enabled": on} | super().metrics()
