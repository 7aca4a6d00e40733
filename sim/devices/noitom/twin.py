"""The twin of a Perception Neuron suit's software: it broadcasts BVH frames (sheet noitom_perception_neuron)."""

from __future__ import annotations

import socket
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from srl.drivers.noitom.protocol import encode_binary, encode_text
from srl.drivers.noitom.skeleton import JOINTS
from srl.sim.devices.noitom.fake import FakeNoitom
from srl.sim.devices.shared.sockets import SocketTwin, TcpDoor, UdpDoor

_KEPT: Final = 0.4  # s of frames sent together after the software has been busy; older ones are dropped


class NoitomTwin(SocketTwin):
    """Sends each sample of the fake when it reaches a client of the fake, with a separate frame for each avatar.

    By TCP it serves at most four clients, like Axis Neuron. If the device's `port` is `udp://...`, it sends datagrams
    to that port of this host (port 0: to a free one), like Axis Studio. It takes no commands and sends no greeting.
    """

    def __init__(self, fake: FakeNoitom) -> None:
        super().__init__(fake)
        self.software = fake
        self._tcp, self._udp = TcpDoor(), UdpDoor()
        self._datagrams = fake.suit.port.startswith("udp://")
        self._port = (urlsplit(fake.suit.port).port or 0) if self._datagrams else 0
        self._text = fake.broadcast.format == "text"
        others = [k for k in range(fake.broadcast.others + 1) if k != fake.suit.avatar][: fake.broadcast.others]
        self._avatars = sorted([fake.suit.avatar, *others])
        self._standing = fake.frame(fake.body.offsets, np.zeros((JOINTS, 3)))
        self._last = -1
        self._frames = 0
        self._log: list[tuple[int, int, int]] = []

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._udp if self._datagrams else self._tcp]

    def describe(self) -> str:
        if not self._datagrams:
            return self._tcp.address
        self._port = self._port or _free_port()
        return f"udp://127.0.0.1:{self._port}"

    def opened(self) -> None:
        self._last = self.software.newest()

    def work(self, now: int) -> None:
        for client in self._tcp.accept():
            client.read()
        for client in self._tcp.clients:
            client.read()  # clients send nothing; reading detects closed connections
        self._udp.read()
        newest = self.software.newest()
        if newest < self._last:  # the world was restored to an earlier state
            self._last = newest - 1
        kept = int(_KEPT * self.software.broadcast.rate)
        for number in range(max(self._last, newest - kept, -1) + 1, newest + 1):
            values = self.software.sample(number)
            if values is not None:
                self._send(number, values, now)
        self._last = newest

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: number of frames sent."""
        return super().metrics() | {"frames": self._frames}

    def log(self) -> dict[str, NDArray[Any]]:
        """`sent_ns` (k,): when each frame was sent. `taken_ns` (k,): its world time. `frame` (k,): its number."""
        sent, taken, frame = np.array(self._log, np.int64).reshape(-1, 3).T
        return {"sent_ns": sent, "taken_ns": taken, "frame": frame}

    def _send(self, number: int, values: NDArray[np.float64], now: int) -> None:
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
        self._frames += 1
        if self.keep_log:
            self._log.append((now, self.software.taken_at(number), number))


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
