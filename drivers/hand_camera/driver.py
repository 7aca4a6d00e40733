"""A hand that a camera sees, as a device."""

from __future__ import annotations

from srl.drivers.hand_camera.config import HandCameraConfig
from srl.drivers.udp_messages.driver import UdpMessages


class HandCamera(UdpMessages):
    """Landmarks of a hand. What finds them in pictures is a program of its own, so it can't delay the loop.

    States: `landmarks` (21, 3), m, in the camera's axes; `confidence` (1,), 0 to 1; `right` (1,), 1 for a right hand. A
    message of the other hand, or with too little confidence, is no sample: without a hand the device becomes stale.
    """

    Config = HandCameraConfig
    summary = "a hand seen by a webcam: 21 landmarks of a tracker such as MediaPipe (UDP)"
    gives = ("landmarks", "confidence", "right")
    max_age = 0.3

    def __init__(self, name: str, config: HandCameraConfig) -> None:
        super().__init__(name, config.messages())
        self.states = config.states()
