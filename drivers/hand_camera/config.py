"""Options of a hand that a camera sees, and the messages that tell of it."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from srl.drivers.udp_messages.config import UdpMessagesConfig
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.human_hand import POINTS

FROZEN: Final = 0.5  # s for which a picture may stay the same to the last digit: a camera that hangs repeats it
REACH: Final = 5.0  # m; a landmark farther from the origin is none


class HandCameraConfig(DeviceConfig):
    """Options of the device.

    A message is a JSON object: `frame`, a number that grows; `time`, s, when the picture was taken, from any zero;
    `right`, whether it is a right hand; `confidence`, 0 to 1; `landmarks`, 21 of [x, y, z] in m, in right-handed axes
    of the camera's, in the order of MediaPipe.
    """

    port: str = Field("udp://127.0.0.1:5006", description="udp://ADDRESS:PORT of this host, on which it listens")
    sender: str | None = Field(None, description="address of the only host that counts; none: the first that sends")
    hand: Literal["right", "left"] = Field("right", description="messages of the other hand are no samples")
    confidence: float = Field(0.6, ge=0, lt=1, description="of the tracker; a message with less is no sample")
    latency: float = Field(0.03, ge=0, le=0.5, description="s, from the exposure to the time that the message tells")
    silence: float = Field(2.0, ge=0.2, le=60, description="s without a hand until the device is opened anew")
    start: float = Field(5.0, gt=0, le=60, description="s until the first hand")

    def messages(self) -> UdpMessagesConfig:
        """The same as options of `udp-messages`."""
        right = float(self.hand == "right")
        names = [(f"{point}_{axis}", i, k) for i, point in enumerate(POINTS) for k, axis in enumerate(POINT)]
        places = {name: f"landmarks.{i}.{k}" for name, i, k in names}
        return UdpMessagesConfig.model_validate({
            "port": self.port, "sender": self.sender, "sequence": "frame", "time": "time", "latency": self.latency,
            "silence": self.silence, "start": self.start, "frozen": FROZEN, "signals": {
                "landmarks": {"elements": places, "unit": "m", "lower": -REACH, "upper": REACH},
                "confidence": {"elements": {"hand": "confidence"}, "unit": "1", "lower": self.confidence, "upper": 1.0},
                "right": {"elements": {"hand": "right"}, "unit": "1", "lower": right - 0.5, "upper": right + 0.5},
            },
        })  # fmt: skip

    def states(self) -> tuple[Signal, ...]:
        """The signals, as declared by both the driver and its fake."""
        return (
            Signal(name="landmarks", shape=(21, 3), unit="m", labels=POINTS, components=(POINT,)),
            Signal(name="confidence", shape=(1,), unit="1", labels=("hand",)),
            Signal(name="right", shape=(1,), unit="1", labels=("hand",)),
        )
