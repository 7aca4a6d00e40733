"""The twin of a program that tracks a hand before a camera: it sends landmarks to the profile's port on this host."""

from __future__ import annotations

import json
from typing import Final
from urllib.parse import urlsplit

from srl.sim.devices.hand_camera.fake import FakeHandCamera
from srl.sim.devices.shared.sockets import TcpDoor, UdpDoor, free_port
from srl.sim.devices.shared.stream_twin import StreamTwin

_MOST: Final = 5  # pictures sent at once, after the twin was busy


class HandCameraTwin(StreamTwin):
    """Each picture's hand is a message.

    Attributes:
        right: whether it takes the hand for a right one.
    """

    def __init__(self, fake: FakeHandCamera) -> None:
        super().__init__(fake, _MOST)
        self.tracker = fake
        self._door, self._port = UdpDoor(), urlsplit(fake.camera.port).port or 0
        self.right = fake.camera.hand == "right"

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._door]

    def describe(self) -> str:
        self._port = self._port or free_port()
        return f"udp://127.0.0.1:{self._port}"

    def work(self, now: int) -> None:
        self._door.read()
        for number, values in self.due.take():
            content = {
                "frame": number, "time": self.tracker.taken_at(number) * 1e-9, "right": self.right,
                "confidence": self.tracker.confidence(number),
                "landmarks": self.tracker.landmarks(values, number).round(6).tolist(),
            }  # fmt: skip
            self._door.write(json.dumps(content).encode(), ("127.0.0.1", self._port))
            self.sent(number, number, now)
