"""The twin of a program that tracks a hand before a camera: it sends landmarks to the profile's port on this host."""

from __future__ import annotations

import json
from typing import Final

from srl.runtime.contracts.signals import Array
from srl.sim.devices.hand_camera.fake import FakeHandCamera
from srl.sim.devices.shared.datagram_twin import DatagramTwin

_MOST: Final = 5  # pictures sent at once, after the twin was busy


class HandCameraTwin(DatagramTwin):
    """Each picture's hand is a message.

    Attributes:
        right: whether it takes the hand for a right one.
    """

    def __init__(self, fake: FakeHandCamera) -> None:
        super().__init__(fake, _MOST, fake.camera.port)
        self.tracker = fake
        self.right = fake.camera.hand == "right"

    def message(self, number: int, values: Array) -> bytes:
        content = {
            "frame": number, "time": self.tracker.taken_at(number) * 1e-9, "right": self.right,
            "confidence": self.tracker.confidence(number),
            "landmarks": self.tracker.landmarks(values, number).round(6).tolist(),
        }  # fmt: skip
        return json.dumps(content).encode()
