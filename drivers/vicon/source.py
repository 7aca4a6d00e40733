"""What both wires give: the newest frame, in the server's own count, in m and unit quaternions."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from drivers.vicon.blocks import Point
from drivers.vicon.geometry import Quaternion


@dataclass(slots=True)
class Frame:
    """One frame, what is visible of it.

    Attributes:
        number: the server's frame number, which wraps at 2**32.
        latency: ns from exposure to sending, as the server says.
        segments: row, position, orientation. markers: row, position. unlabelled: positions.
    """

    number: int
    latency: int = 0
    segments: list[tuple[int, Point, Quaternion]] = field(default_factory=list)
    markers: list[tuple[int, Point]] = field(default_factory=list)
    unlabelled: list[Point] = field(default_factory=list)


class Source(Protocol):
    """One wire."""

    @property
    def period(self) -> Fraction:
        """ns from frame to frame; known after `open`, and may change."""

    @property
    def frames(self) -> int:
        """Good frames over its life."""

    @property
    def errors(self) -> int:
        """Those thrown away."""

    @property
    def resyncs(self) -> int:
        """Times the next frame had to be searched for."""

    @property
    def remark(self) -> str:
        """The newest one, for people; "" if all is well."""

    def open(self) -> None:
        """Connects and identifies. May block. Raises DeviceError."""

    def read(self, now: int) -> Frame | None:
        """Takes all that has come; the newest frame, if there is one. Never blocks. Raises DeviceLostError."""

    def close(self) -> None:
        """Always succeeds."""
