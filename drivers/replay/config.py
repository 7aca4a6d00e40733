"""The options of a recorded device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, Self

from pydantic import Field, ValidationError, model_validator

from srl.drivers.capture.config import CaptureConfig
from srl.drivers.noitom.skeleton import Kind
from srl.drivers.xsens_mvn.config import MvnConfig
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.files import ProfilePath
from srl.runtime.contracts.validation import refusal

ANY: Final = "*"  # the subject of a marker whose subject isn't named
OPTIONS: Final[Mapping[str, frozenset[str]]] = {
    ".bvh": frozenset({"skeleton"}),
    ".mvnx": frozenset({"skeleton", "segments", "joints", "centre_of_mass", "required", "frame"}),
    ".c3d": frozenset({"markers", "plates", "up", "required", "frame"}),
}
"""The options of each kind of file, by its ending."""
_COMMON: Final = frozenset({"recording", "start", "at_end"})
_OURS: Final = frozenset({"device"})  # of srl's own recordings


class ReplayConfig(DeviceConfig):
    """Options of a recorded device. Those of motion files have the names that the system's own driver gives them."""

    recording: ProfilePath = Field(
        description="FILE.rrd, a folder of segments, or a black box; or a motion file: .bvh, .mvnx, .c3d"
    )
    device: str = Field("", description="of a recording of srl: the recorded device whose states are given")
    start: float = Field(0.0, ge=0, description="s of the recording that are skipped")
    at_end: Literal["lose", "hold", "loop"] = Field(
        "lose", description="lose: the device is gone; hold: its last sample stays new; loop: it begins again"
    )
    skeleton: Kind | None = Field(
        None, description="of a .bvh or .mvnx: the suit's tree of 59 joints; without it, an .mvnx gives MVN's segments"
    )
    segments: dict[str, str] = Field(
        default_factory=dict, description="of an .mvnx: name: MVN's segment; all if not given"
    )
    joints: tuple[str, ...] = Field((), description="of an .mvnx: MVN's joints whose angles are given")
    centre_of_mass: bool = Field(False, description="of an .mvnx: the body's centre of mass is given, too")
    markers: dict[str, str] = Field(
        default_factory=dict, description="of a .c3d: name: SUBJECT/MARKER or MARKER; all if not given"
    )
    plates: bool = Field(False, description="of a .c3d: the wrenches of its force plates are given, too")
    up: Literal["y", "z"] | None = Field(
        None, description="of a .c3d: the axis that points up; null: what the file says, else z"
    )
    required: tuple[str, ...] = Field(
        (), description="of an .mvnx or .c3d: names that must all be seen for a frame to count; none: any one of them"
    )
    frame: str | None = Field(None, description="of an .mvnx or .c3d: frame of the profile's tree that its origin is")

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        ending = self.recording.suffix.lower()
        known = OPTIONS.get(ending, _OURS)
        if wrong := sorted(self.model_fields_set - known - _COMMON):
            what = f"a motion file {ending}" if ending in OPTIONS else "a recording of srl"
            raise ValueError(f"'{wrong[0]}' is no option of {what}; it has {', '.join(sorted(known))}")
        if ending not in OPTIONS and not self.device:
            raise ValueError("name the recorded 'device' of a recording of srl")
        checked(self)
        return self


def checked(config: ReplayConfig) -> CaptureConfig | None:
    """The options as those of the system's own driver; None: it has none. Raises ValueError: it would refuse them."""
    common: dict[str, Any] = {"required": config.required, "frame": config.frame}
    try:
        if config.recording.suffix.lower() == ".c3d" and config.markers:
            markers = {name: target if "/" in target else f"{ANY}/{target}" for name, target in config.markers.items()}
            return CaptureConfig(markers=markers, **common)
        if config.recording.suffix.lower() == ".mvnx":
            own = {"segments": config.segments} if config.segments else {}
            return MvnConfig(port="", joints=config.joints, centre_of_mass=config.centre_of_mass, **own, **common)
    except ValidationError as error:
        raise ValueError(refusal(error).problem) from None
    return None
