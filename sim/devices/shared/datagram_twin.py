"""The twin of a program that sends each sample as a datagram, to the port of the profile on this host."""

from __future__ import annotations

from abc import abstractmethod
from urllib.parse import urlsplit

from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.sensor import SampledFake
from srl.sim.devices.shared.sockets import TcpDoor, UdpDoor, free_port
from srl.sim.devices.shared.stream_twin import StreamTwin


class DatagramTwin(StreamTwin):
    """Each sample of the fake is a datagram to 127.0.0.1, whatever the address of the profile's port."""

    def __init__(self, fake: SampledFake, most: int, port: str) -> None:
        """`most`: as in `Due`; `port`: of the profile, udp://ADDRESS:PORT."""
        super().__init__(fake, most)
        self._door, self._port = UdpDoor(), urlsplit(port).port or 0

    @abstractmethod
    def message(self, number: int, values: Array) -> bytes:
        """The datagram of a sample."""

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._door]

    def describe(self) -> str:
        self._port = self._port or free_port()
        return f"udp://127.0.0.1:{self._port}"

    def work(self, now: int) -> None:
        self._door.read()
        for number, values in self.due.take():
            self._door.write(self.message(number, values), ("127.0.0.1", self._port))
            self.sent(number, number, now)
