"""The states of a capture system, the same for a driver over any wire and for its fake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import numpy as np

from srl.drivers.capture.config import CaptureConfig
from srl.drivers.capture.names import Point
from srl.runtime.contracts.rotation import Quaternion
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE

GIVES: Final = ("pose", "<name>.pose", "visible", "markers", "marker_visible", "unlabelled", "unlabelled_visible")


def signals(config: CaptureConfig) -> tuple[Signal, ...]:
    """Returns the device's states; only those that the profile requests."""
    made: list[Signal] = []
    if config.segments:
        labels, k = tuple(config.segments), len(config.segments)
        made += [
            Signal(name="pose", shape=(k, 7), unit="m", frame=config.frame, labels=labels, components=(POSE,)),
            Signal(name="visible", shape=(k,), unit="1", labels=labels),
        ]
        made += [Signal(name=f"{name}.pose", shape=(7,), unit="m", frame=config.frame, labels=POSE) for name in labels]
    if config.markers:
        labels, k = tuple(config.markers), len(config.markers)
        made += [
            Signal(
                name="markers",
                shape=(k, 3),
                unit="m",
                frame=config.frame,
                labels=labels,
                components=(POINT,),
                visual="points",
            ),
            Signal(name="marker_visible", shape=(k,), unit="1", labels=labels),
        ]
    if k := config.unlabelled:
        made += [
            Signal(
                name="unlabelled",
                shape=(k, 3),
                unit="m",
                frame=config.frame,
                slots=True,
                components=(POINT,),
                visual="points",
            ),
            Signal(name="unlabelled_visible", shape=(k,), unit="1", slots=True),
        ]
    return tuple(made)


class Seen(Protocol):
    """The visible part of a frame, m and unit quaternions: row and pose, row and position, position."""

    @property
    def segments(self) -> Sequence[tuple[int, Point, Quaternion]]: ...
    @property
    def markers(self) -> Sequence[tuple[int, Point]]: ...
    @property
    def unlabelled(self) -> Sequence[Point]: ...


class View:
    """Fills the states frame by frame. An occluded row of `pose` keeps its last pose.

    A segment's own state does so for a while only, and is NaN then.

    Attributes:
        seen: whether the frame shows what the profile requires, so that it counts as a sample.
    """

    def __init__(self, config: CaptureConfig) -> None:
        segments, markers = list(config.segments), list(config.markers)
        self.seen = False
        self._need_segments = [segments.index(name) for name in config.required if name in config.segments]
        self._need_markers = [markers.index(name) for name in config.required if name in config.markers]
        self._names = segments
        self._poses: list[Array] = []
        self._shown = [0] * len(segments)  # ns, when each was seen last
        none = np.empty(0)
        self._pose = self._visible = self._markers = self._marker_visible = none
        self._unlabelled = self._unlabelled_visible = none

    def bind(self, arrays: Mapping[str, Array]) -> None:
        """Takes the state arrays. A row of `pose` that was never seen is the identity."""
        none = np.empty(0)
        self._pose, self._visible = arrays.get("pose", none), arrays.get("visible", none)
        self._markers, self._marker_visible = arrays.get("markers", none), arrays.get("marker_visible", none)
        self._unlabelled = arrays.get("unlabelled", none)
        self._unlabelled_visible = arrays.get("unlabelled_visible", none)
        self._poses = [arrays[f"{name}.pose"] for name in self._names]
        for row in range(len(self._poses)):
            self._pose[row] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        for single in self._poses:
            single[:] = np.nan
        for array in (self._markers, self._unlabelled):
            array[...] = 0.0
        self.begin()

    def begin(self) -> None:
        """Begins a new frame: nothing is visible yet."""
        for visible in (self._visible, self._marker_visible, self._unlabelled_visible):
            visible[...] = 0.0

    def segment(self, row: int, p: Point, q: Quaternion) -> None:
        """Takes a visible segment: m, unit quaternion. Of q and -q it uses the one nearer to the last pose."""
        w, x, y, z = q
        pose = self._pose[row]
        if pose[3] * w + pose[4] * x + pose[5] * y + pose[6] * z < 0.0:
            w, x, y, z = -w, -x, -y, -z
        pose[:] = (*p, w, x, y, z)
        self._poses[row][:] = pose
        self._visible[row] = 1.0

    def marker(self, row: int, p: Point) -> None:
        """Takes a visible labelled marker, m."""
        self._markers[row] = p
        self._marker_visible[row] = 1.0

    def reflection(self, row: int, p: Point) -> None:
        """Takes an unlabelled marker, m."""
        self._unlabelled[row] = p
        self._unlabelled_visible[row] = 1.0

    def show(self, seen: Seen, taken: int, hold: int) -> None:
        """Takes a whole frame; arguments as those of `end`."""
        self.begin()
        for row, p, q in seen.segments:
            self.segment(row, p, q)
        for row, p in seen.markers:
            self.marker(row, p)
        for row, p in enumerate(seen.unlabelled):
            self.reflection(row, p)
        self.end(taken, hold)

    def end(self, taken: int, hold: int) -> None:
        """Completes the frame, taken at `taken`, ns.

        A segment that is hidden for longer than `hold`, ns, has no pose: whoever gets its own state, over the bus too,
        sees that it is none.
        """
        for row, visible in enumerate(self._visible.tolist()):
            if visible:
                self._shown[row] = taken
            elif taken - self._shown[row] > hold:
                self._poses[row][:] = np.nan
        if self._need_segments or self._need_markers:
            self.seen = bool(
                all(self._visible[row] for row in self._need_segments)
                and all(self._marker_visible[row] for row in self._need_markers)
            )
        else:
            self.seen = bool(self._visible.any() or self._marker_visible.any() or self._unlabelled_visible.any())
