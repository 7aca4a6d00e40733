"""An OptiTrack system that observes a simulated cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from drivers.capture.names import Segment, Subject
from drivers.natnet import NatNet, NatNetConfig
from drivers.natnet.protocol import Version
from runtime.contracts.driver import DeviceConfig
from runtime.contracts.errors import DeviceError
from runtime.contracts.world import FakeConfig, World
from sim.devices.shared.cameras import Cameras, CamerasConfig


class FakeNatNetConfig(CamerasConfig):
    """Options of the fake; all but those of `CamerasConfig` are for the twin's stream."""

    natnet: Literal["3.0", "3.1", "4.0", "4.1", "4.2"] = Field("4.1", description="version of the stream")
    multicast: bool = Field(False, description="frames are sent to a group; otherwise to each client")
    y_up: bool | None = Field(None, description="its y axis is up, else its z axis; null: as the profile says")
    usb: bool = Field(False, description="the cameras don't stamp the exposure")

    @property
    def version(self) -> Version:
        """Of the stream."""
        major, minor = map(int, self.natnet.split("."))
        return Version(major, minor)


class FakeNatNet(Cameras):
    """See `Cameras`. A subject of one segment is a rigid body, one of several a skeleton."""

    Options = FakeNatNetConfig
    real = NatNet

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config, world, options)
        assert isinstance(config, NatNetConfig)
        assert isinstance(options, FakeNatNetConfig)
        self.optitrack, self.motive = config, options
        self.y_up = config.up == "y" if options.y_up is None else options.y_up

    def open(self) -> None:
        super().open()
        rate, needed = self.seen_by.rate, self.optitrack.rate
        if rate < needed * 0.99:
            self.close()
            raise DeviceError(
                self.name,
                f"the simulated Motive captures {rate:g} frames a second, the profile needs {needed:g}",
                f"Set 'sim.devices.{self.name}.rate' or the device's 'rate'",
            )

    def offered(self, subjects: Sequence[Subject]) -> Sequence[Subject]:
        """A rigid body has no segments of other names."""
        return [
            subject._replace(segments=(Segment(1, subject.name, 0),)) if len(subject.segments) == 1 else subject
            for subject in subjects
        ]
