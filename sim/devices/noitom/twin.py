"""The twin of a Perception Neuron suit's software: it broadcasts BVH frames (sheet noitom_perception_neuron)."""

from __future__ import annotations

from typing import Final
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from srl.drivers.noitom.protocol import encode_binary, encode_text
from srl.drivers.noitom.skeleton import JOINTS
from srl.sim.devices.noitom.fake import FakeNoitom
from srl.sim.devices.shared.sockets import TcpDoor, UdpDoor, free_port
from srl.sim.devices.shared.stream_twin import StreamTwin

_KEPT: Final = 0.4  # s of frames sent together after the software has been busy; older ones are dropped


class NoitomTwin(StreamTwin):
    """Sends each sample of the fake when it reaches a client of the fake, with a separate frame for each avatar.

    By TCP it serves at most four clients, like Axis Neuron. If the device's `port` is `udp://...`, it sends datagrams
    to that port of this host (port 0: to a free one), like Axis Studio. It takes no commands and sends no greeting.
    """

    def __init__(self, fake: FakeNoitom) -> None:
        super().__init__(fake, int(_KEPT * fake.broadcast.rate))
        self.software = fake
        self._tcp, self._udp = TcpDoor(), UdpDoor()
        self._datagrams = fake.suit.port.startswith("udp://")
        self._port = (urlsplit(fake.suit.port).port or 0) if self._datagrams else 0
        self._text = fake.broadcast.format == "text"
        others = [k for k in range(fake.broadcast.others + 1) if k != fake.suit.avatar][: fake.broadcast.others]
        self._avatars = sorted([fake.suit.avatar, *others])
        self._standing = fake.frame(fake.body.offsets, np.zeros((JOINTS, 3)))

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._udp if self._datagrams else self._tcp]

    def describe(self) -> str:
        if not self._datagrams:
            return self._tcp.address
        self._port = self._port or free_port()
        return f"udp://127.0.0.1:{self._port}"

    def work(self, now: int) -> None:
        for client in self._tcp.accept():
            client.read()
        for client in self._tcp.clients:
            client.read()  # clients send nothing; reading detects closed connections
        self._udp.read()
        for number, values in self.due.take():
            self._send(number, values)
            self.sent(number, number, now)

    def _send(self, number: int, values: NDArray[np.float64]) -> None:
        for avatar in self._avatars:
            numbers = values if avatar == self.software.suit.avatar else self._standing
            name = f"Char{avatar:02d}"
            if self._text:
                data = encode_text(numbers, avatar, name)
            else:
                data = encode_binary(numbers, number % (1 << 32), avatar, name)
            if self._datagrams:
                self._udp.write(data, ("127.0.0.1", self._port))
            for client in self._tcp.clients:
                client.write(data)
