"""What simulated cameras see of a part: a subject of the capture system, with segments and markers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from srl.sim.world.part import Part


@dataclass(frozen=True)
class SeenSegment:
    """A segment of a subject: its body in the cell, and the segment that it hangs on ("" for a root)."""

    body: str
    parent: str = ""


class MocapSubject(Part):
    """A part that cameras see. Set its attributes in `__init__`.

    Each marker is a site `<name>/<label>` on its segment's body.

    Attributes:
        subject: its name in the capture system.
        segments: by name there, a parent before its children.
        markers: the segment of each marker, by label.
    """

    subject: str
    segments: Mapping[str, SeenSegment]
    markers: Mapping[str, str]
