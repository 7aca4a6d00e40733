"""The interface of both wires: the newest frame, in the server's own count, in m and unit quaternions."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from srl.drivers.capture.names import Point
from srl.runtime.contracts.rotation import Quaternion


@dataclass(slots=True)
class Frame:
    """The visible part of one frame.

    Attributes:
        number: the server's frame number, which wraps at 2**32.
        latency: ns from exposure to sending, as the server reports it.
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
        """ns per frame; known after `open`, and may change."""

    @property
    def frames(self) -> int:
        """Good frames over its life."""

    @property
    def errors(self) -> int:
        """Frames discarded."""

    @property
    def resyncs(self) -> int:
        """Number of times the next frame had to be searched for."""

    @property
    def remark(self) -> str:
        """The newest message for the user; "" if all is well."""

    def open(self) -> None:
        """Connects and identifies. May block. Raises DeviceError."""

    def read(self, now: int) -> Frame | None:
        """Takes everything that has arrived; returns the newest frame, if any. Never blocks. Raises DeviceLostError."""

    def close(self) -> None:
        """Closes the connection. Always succeeds."""
