"""An OptiTrack system that observes a simulated cell."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Final, Literal

from pydantic import Field

from srl.drivers.capture.names import Segment, Subject
from srl.drivers.natnet import NatNet, NatNetConfig
from srl.drivers.natnet.protocol import Version
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.cameras import Cameras, CamerasConfig
from srl.sim.parts.body.body import BodyPart

_BONES: Final = (sqrt(0.5), -sqrt(0.5), 0.0, 0.0)  # x left, z up, y back in the suit's x left, y up, z forward


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
    """See `Cameras`. A subject of one segment is a rigid body, one of several a skeleton.

    A skeleton on the part `body` has Motive's axes, which are those of the suit's with y up."""

    Options = FakeNatNetConfig
    real = NatNet

    def __init__(self, name: str, config: NatNetConfig, world: World, options: FakeNatNetConfig) -> None:
        super().__init__(name, config, world, options)
        self.optitrack, self.motive = config, options
        # In the T-pose Motive's bones have the world's axes, y up and z ahead, as the suit's have; the driver renames
        # those of world and bones.
        for subject, bodies in options.bodies.items():
            part, _, _ = next(iter(bodies.values())).partition("/")
            if len(bodies) > 1 and isinstance(self.cell.parts.get(part), BodyPart):
                self.scene.turn(subject, _BONES)
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
