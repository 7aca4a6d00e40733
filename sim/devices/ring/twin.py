"""The twins of a ring: a Bluetooth remote's events, or the lines of a self-made ring."""

from __future__ import annotations

from srl.drivers.evdev import Description
from srl.drivers.ring.serial_ring import ASK
from srl.runtime.contracts.world import Twin
from srl.sim.devices.ring.fake import FakeRing
from srl.sim.devices.shared.evdev import EventTwin
from srl.sim.devices.shared.serial import SerialTwin

_HEARTBEAT = 100_000_000  # ns


def ring_twin(fake: FakeRing) -> Twin:
    """Returns the twin for the profile's `port`: an input device for 'input' and nodes, else a serial line."""
    port = fake.config.port
    return InputRing(fake) if port == "input" or port.startswith("/dev/input") else SerialRing(fake)


class InputRing(EventTwin):
    """A shutter remote: its key goes down and up. While it is asleep, its device node doesn't exist."""

    def __init__(self, fake: FakeRing) -> None:
        super().__init__(fake)
        self.ring = fake

    def present(self) -> bool:
        return not self.ring.asleep()

    def describe(self) -> Description:
        """The remote's own chip has already debounced the key."""
        key = self.ring.config.keys[0]
        pressed = frozenset([key] if self.ring.contact() else [])
        return Description(
            "AB Shutter3 Consumer Control", "ff:ff:00:00:00:01", 0x248A, 0x8266, 1, frozenset([key]), pressed
        )


class SerialRing(SerialTwin):
    """Sends lines: each edge of the contact, a heartbeat every 100 ms, its name on request."""

    def __init__(self, fake: FakeRing) -> None:
        super().__init__(fake)
        self.ring = fake
        self._level = 0.0
        self._beat = 0

    def connected(self, now: int) -> None:
        """Opening the port resets such boards."""
        self.door.write(b"V ring1 1\n")

    def receive(self, data: bytes, now: int) -> bytes:
        return b"V ring1 1\n" * data.count(ASK)

    def work(self, now: int) -> bytes:
        time, level, lines = self.ring.world.time, self.ring.contact(), b""
        if level != self._level:
            self._level = level
            lines += b"B%d\n" % level
        if time // _HEARTBEAT != self._beat:
            self._beat = time // _HEARTBEAT
            lines += b"H%d %d\n" % (level, time // 1_000_000 % (1 << 32))
        return lines
