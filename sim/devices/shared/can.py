"""What the twins of devices on a CAN bus share: the bus, the loss of the cable, counts."""

from __future__ import annotations

from abc import abstractmethod

import can

from srl.drivers.canbus import CanLink, open_can
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.world import Fake, Twin
from srl.sim.devices.shared.sockets import free_port
from srl.sim.devices.shared.windows import Windows, inside

GROUP = "239.74.163.2"  # python-can's default group for its multicast bus


class CanTwin(Twin):
    """A twin on a CAN bus of python-can.

    During the `loss` windows of the fake's options it is off the bus, as without power; afterwards it powers up.

    Attributes:
        muted: the device neither obeys nor sends.
        bus: the can://... URL of its bus: the fake's option `bus`, by default a multicast bus whose frames don't leave
            this host. Several twins may share one.
    """

    def __init__(self, fake: Fake) -> None:
        super().__init__(fake)
        self.muted = False
        self.bus: str | None = getattr(fake.options, "bus", None)
        self._loss: Windows = getattr(fake.options, "loss", ())
        self._link: CanLink | None = None
        self._gone = False
        self._unsent = 0

    def open(self) -> None:
        """Raises DeviceError if the bus isn't available."""
        self.close()
        if self.bus is None:
            # hop_limit 0: the frames stay on this host. A separate port for each twin allows several buses.
            self.bus = f"can://udp_multicast/{GROUP}?port={free_port()}&hop_limit=0"
        self._link = open_can(self.bus, place=f"twin of {self.fake.name}")
        self.address = self.bus
        self.power_up()

    def close(self) -> None:
        link, self._link = self._link, None
        self.address = ""
        if link is not None:
            link.close()

    def service(self, now: int) -> None:
        gone = inside(self._loss, self.fake.world.time)
        if gone != self._gone:
            self._gone = gone
            if gone:
                self.power_down()
            else:
                self.power_up()
        link = self._link
        if link is None:
            return
        messages = link.read()
        if gone or self.muted:
            self.idle()
            return
        for message in messages:
            self.take(message, now)
        self.work(now)

    @abstractmethod
    def power_up(self) -> None:
        """Sets the state after a loss of power."""

    def power_down(self) -> None:
        """Its supply is gone."""

    @abstractmethod
    def take(self, message: can.Message, now: int) -> None:
        """Obeys a frame from the bus, if it is meant for the device."""

    def work(self, now: int) -> None:
        """Does what the device does by itself."""

    def idle(self) -> None:
        """Passes a step in which the device neither obeys nor sends."""

    def send(self, can_id: int, data: bytes, extended: bool = False) -> None:
        """Sends a frame; one for which the bus has no room is counted."""
        link = self._link
        if link is None:
            return
        try:
            sent = link.write(can.Message(arbitration_id=can_id, data=data, is_extended_id=extended))
        except DeviceError:
            sent = False
        self._unsent += not sent

    def metrics(self) -> dict[str, object]:
        """Frames for which the bus had no room."""
        return {"unsent": self._unsent}
