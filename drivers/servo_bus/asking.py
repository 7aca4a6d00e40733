"""Packets to one servo at a time, blocking, on any bus with this framing: for opening it, not for the loop."""

from __future__ import annotations

import time
from typing import Final

from srl.drivers.servo_bus.packets import Status
from srl.drivers.servo_bus.units import OnLine
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport

TRIES: Final = 5  # a busy host may let three go by
ANSWER: Final = 0.06  # s; a USB adapter alone may take 16 ms each way
ECHO_TRIES: Final = 3


class Asker:
    """Questions over one link.

    Attributes:
        link: the transport.
        bus: who is on it.
        place: the device's name, for errors.
        parser: counts frames, errors, resyncs.
    """

    def __init__(self, link: Transport, bus: OnLine, place: str) -> None:
        self.link, self.bus, self.place = link, bus, place
        self.parser = bus.parser()

    def ask(self, frame: bytes, id: int, size: int | None = None, tries: int = TRIES) -> Status | None:
        """Returns servo `id`'s answer to a packet; None if there is none.

        Args:
            frame: one instruction packet.
            id: the servo that must answer.
            size: bytes of data it must have, unless it reports an error.
            tries: number of times the packet is sent.
        """
        for _ in range(tries):
            self.link.flush_input()
            self.parser.forget()
            self.link.write_all(frame, 1.0)
            for left in remaining(ANSWER + 10 * len(frame) / self.bus.config.baudrate):
                for status in self.parser.statuses(self.link.read_wait(left)):
                    fits = size is None or len(status.data) == size or (status.error and not status.data)
                    if status.id == id and fits:
                        return status
        return None

    def tell(self, frame: bytes) -> None:
        """Sends a packet that may not be acknowledged, and waits until it has been transmitted."""
        self.link.write_all(frame, 1.0)
        time.sleep(0.005 + 20 * len(frame) / self.bus.config.baudrate)

    def echoes(self, id: int) -> bool:
        """Returns whether the adapter echoes the host's own bytes in front of servo `id`'s answer."""
        ping = self.bus.wire.ping(id)
        for _ in range(ECHO_TRIES):
            self.link.flush_input()
            self.link.write_all(ping, 1.0)
            heard = b""
            deadline = time.monotonic() + ANSWER
            while (left := deadline - time.monotonic()) > 0 and len(heard) <= len(ping):
                heard += self.link.read_wait(left)
            # A servo with a voltage error answers with exactly the ping's bytes; after an echo the answer may be late.
            if heard and heard != ping:
                return len(heard) > len(ping) and heard.startswith(ping)
        return False
