"""A Vicon's options in the profile."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.drivers.capture.config import CaptureConfig


class ViconConfig(CaptureConfig):
    """Options of a Vicon server."""

    port: str = Field(description="tcp://HOST:801 for DataStream; udp://:51001 for Tracker's object stream")
    rate: float = Field(
        default=100.0, gt=0, le=2000, description="Hz; DataStream: the least frame rate; object stream: its rate"
    )
    mode: Literal["push", "pull"] = Field(
        default="push", description="DataStream: the server sends each frame, or the driver asks for each"
    )

    @property
    def objects_only(self) -> bool:
        """Whether this is Tracker's object stream."""
        return self.port.startswith("udp://")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.objects_only and (self.markers or self.unlabelled):
            raise ValueError("the object stream has no markers; reach the server by tcp://HOST:801 for them")
        if self.objects_only and any("/" in target for target in self.segments.values()):
            raise ValueError("the object stream has whole objects only; write their names without '/'")
        return self
