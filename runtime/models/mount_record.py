"""Where a frame is in its parent, as `srl calibrate PROFILE frames` found it. `frames.NAME.calibration` names it."""

from __future__ import annotations

import datetime
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, FiniteFloat, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.models.record_file import Name

FORMAT: Final = "srl-frame-1"

_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]
_Three = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
_Four = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]


class Pose(BaseModel):
    """A pose: position, m; quaternion, w x y z, of length 1."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: _Three
    quaternion: _Four

    @model_validator(mode="after")
    def _is_rotation(self) -> Pose:
        if abs(sum(q * q for q in self.quaternion) - 1.0) > 1e-3:
            raise ValueError("the quaternion's length isn't 1")
        return self


class FrameRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        date: of the measurement.
        simulated: of simulated devices, so it says nothing about real ones.
        frame, parent: the pose is that of `frame` in `parent`.
        drivers: the devices that measured, and their drivers.
        serials: of those of them whose entry in the profile had `serial`.
        signals: the poses that were measured: in the parent, and in the frame (not with known points).
        what: points or poses.
        count: how many.
        pose: of the frame in its parent.
        body: of poses: the body that the parent's signal shows, in the one that the frame's signal shows.
        left: m, rad: the most that is left of one.
        uncertain: m, rad: standard deviations of the place and of the rotation.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-frame-1"]
    date: datetime.date
    simulated: bool
    frame: Name
    parent: str
    drivers: Annotated[dict[str, str], Field(min_length=1)]
    serials: dict[str, str] = Field(default_factory=dict)
    signals: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)]
    what: Literal["points", "poses"]
    count: Annotated[int, Field(ge=4, le=1000)]
    pose: Pose
    body: Pose | None
    left: tuple[_NotNegative, _NotNegative]
    uncertain: tuple[_NotNegative, _NotNegative]

    @model_validator(mode="after")
    def _is_whole(self) -> FrameRecord:
        if {signal.partition(".")[0] for signal in self.signals} != set(self.drivers):
            raise ValueError("the signals aren't those of the devices that measured")
        if not self.serials.keys() <= self.drivers.keys():
            raise ValueError("the serial numbers aren't those of the devices that measured")
        if (self.body is not None) != (self.what == "poses"):
            raise ValueError("poses have a body, and points have none")
        return self
