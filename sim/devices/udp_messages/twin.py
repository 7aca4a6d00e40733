"""The twin of a program that sends numbers by UDP, to the port of the profile on this host."""

from __future__ import annotations

from typing import Final
from urllib.parse import urlsplit

from srl.drivers.udp_messages.protocol import json_message, osc_message
from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.sockets import TcpDoor, UdpDoor, free_port
from srl.sim.devices.shared.stream_twin import StreamTwin
from srl.sim.devices.udp_messages.fake import FakeUdpMessages

_MOST: Final = 20  # samples sent at once, after the twin was busy


class UdpMessagesTwin(StreamTwin):
    """Each sample of the fake is a datagram. An address that isn't of this host is sent to as 127.0.0.1.

    Attributes:
        host: the address to which it sends.
    """

    def __init__(self, fake: FakeUdpMessages) -> None:
        super().__init__(fake, _MOST)
        self.sender = fake
        self._door = UdpDoor()
        self.host, self._port = "127.0.0.1", urlsplit(fake.messages.port).port or 0

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._door]

    def describe(self) -> str:
        self._port = self._port or free_port()
        return f"udp://{self.host}:{self._port}"

    def work(self, now: int) -> None:
        self._door.read()
        for number, values in self.due.take():
            self._door.write(self.message(number, values), (self.host, self._port))
            self.sent(number, number, now)

    def message(self, number: int, values: Array) -> bytes:
        """The datagram of a sample."""
        config, numbers = self.sender.messages, self.sender.numbers
        content = dict(zip(numbers.places, numbers.numbers(values), strict=True))
        if config.sequence is not None:
            content[config.sequence] = number
        if config.time is not None:
            content[config.time] = self.sender.taken_at(number) * 1e-9
        return json_message(content) if config.format == "json" else osc_message(content)
