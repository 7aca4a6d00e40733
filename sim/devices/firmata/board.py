"""What the twins of boards with StandardFirmata share: an Uno that boots, and pins that nothing is connected to."""

from __future__ import annotations

from abc import abstractmethod

from srl.runtime.contracts.world import Fake
from srl.sim.devices.firmata.standard_firmata import BOOT, StandardFirmata, Wires
from srl.sim.devices.shared.serial import SerialTwin


class BoardTwin(SerialTwin, Wires):
    """A simulated Uno; opening the port resets it.

    The board identifies itself after `boot_delay`. What a client sends before that is lost.

    Attributes:
        boot_delay: s of the twin's clock; a real Uno takes 1.6 to 3.
    """

    def __init__(self, fake: Fake, boot_delay: float = 0.05) -> None:
        super().__init__(fake)
        self.boot_delay = boot_delay
        self._now = 0
        self._booted_at: int | None = None  # time at which the present boot ends
        self.firmware = StandardFirmata(self)

    @abstractmethod
    def reset_pins(self) -> None:
        """What is connected loses its pins."""

    def restart(self) -> None:
        """Resets the board without a client, as after a dip of its supply voltage."""
        self.reset_pins()
        seen, too_long = self.firmware.seen, self.firmware.input.too_long
        self.firmware = StandardFirmata(self)
        self.firmware.seen, self.firmware.input.too_long = seen, too_long
        self._booted_at = self._now + round(self.boot_delay * 1e9)

    def connected(self, now: int) -> None:
        self._now = now
        self.restart()

    def receive(self, data: bytes, now: int) -> bytes:
        self._now = now
        return b"" if self._booted_at is not None else self.firmware.receive(data)

    def work(self, now: int) -> bytes:
        self._now = now
        if self._booted_at is None:
            return self.firmware.loop(self.fake.world.time // 1_000_000)
        if now < self._booted_at:
            return b""
        self._booted_at = None
        return BOOT

    def metrics(self) -> dict[str, object]:
        """Adds to the serial twin's figures: messages by kind, and those that were too long."""
        return super().metrics() | {
            "messages": dict(self.firmware.seen), "too_long": self.firmware.input.too_long,
        }  # fmt: skip
