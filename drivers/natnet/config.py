"""An OptiTrack system's options in the profile."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.drivers.capture.config import CaptureConfig


class NatNetConfig(CaptureConfig):
    """Options of Motive's stream. A rigid body is a SUBJECT without segments, a skeleton's bones are its segments."""

    port: str = Field(description="udp://HOST, Motive's computer; udp://HOST:PORT if its command port isn't 1510")
    up: Literal["y", "z"] = Field("y", description="Up Axis of Motive's streaming settings; the stream doesn't say it")
    rate: float = Field(100.0, gt=0, le=2000, description="Hz, the least frame rate")
    latency: float = Field(
        0.005, ge=0, lt=0.5, description="s from exposure to arrival at Motive, where the cameras don't stamp it (USB)"
    )
    takes: bool = Field(False, description="frames of a take that Motive plays count, too: for tests, never to be worn")

    @model_validator(mode="after")
    def _once(self) -> Self:
        for targets in (self.segments, self.markers):
            wanted = list(targets.values())
            if twice := [target for target in wanted if wanted.count(target) > 1]:
                raise ValueError(f"'{twice[0]}' has two names; give it one")
        return self
