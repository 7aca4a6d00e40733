"""What a profile wants of a capture system: segments and markers by name."""

from __future__ import annotations

import re
from typing import Final, Self

from pydantic import Field, model_validator

from srl.runtime.contracts.driver import DeviceConfig

SLUG: Final = re.compile(r"[a-z][a-z0-9_-]*")
TAKEN: Final = ("pose", "visible", "markers", "marker_visible", "unlabelled", "unlabelled_visible", "meta")


class CaptureConfig(DeviceConfig):
    """Options of a motion capture server. Names on the left are the profile's, on the right the server's."""

    segments: dict[str, str] = Field(
        default_factory=dict, description="name: SUBJECT/SEGMENT; SUBJECT alone is its root, or a single object"
    )
    markers: dict[str, str] = Field(default_factory=dict, description="name: SUBJECT/MARKER")
    unlabelled: int = Field(default=0, ge=0, le=500, description="unlabelled markers to take, at most")
    required: tuple[str, ...] = Field(
        default=(), description="names that must all be seen for a sample to count; none: any one of them"
    )
    frame: str | None = Field(default=None, description="frame of the profile's tree that the server's origin is")

    @model_validator(mode="after")
    def _named(self) -> Self:
        if not self.segments and not self.markers and not self.unlabelled:
            raise ValueError("name at least one of segments, markers, unlabelled")
        for name in (*self.segments, *self.markers):
            if not SLUG.fullmatch(name) or name in TAKEN:
                raise ValueError(f"'{name}' can't be a name here: lower-case letters, digits, - and _; not a signal's")
        if twice := self.segments.keys() & self.markers.keys():
            raise ValueError(f"'{min(twice)}' is a segment and a marker; give them different names")
        for name, target in (*self.segments.items(), *self.markers.items()):
            parts = target.split("/")
            if not all(parts) or len(parts) > 2 or (name in self.markers and len(parts) == 1):
                form = "SUBJECT/MARKER" if name in self.markers else "SUBJECT/SEGMENT or SUBJECT"
                raise ValueError(f"'{target}' isn't {form}")
        for name in self.required:
            if name not in self.segments and name not in self.markers:
                raise ValueError(f"'{name}' under required is no segment and no marker of this device")
        return self
