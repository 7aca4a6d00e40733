"""Cameras that observe a simulated cell, with sampling, noise, delay and occlusion: what their fakes share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from srl.drivers.capture.config import CaptureConfig
from srl.drivers.capture.names import Subject
from srl.drivers.capture.selection import refuse, select
from srl.drivers.capture.view import View
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError, WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.scene import Scene
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.parts.body.subject import MocapSubject

_LEVER: Final = 0.05  # m between markers: position noise divided by it is the orientation's noise
_ENOUGH: Final = 3  # markers needed to find a segment
Vector = tuple[float, float, float]


class CamerasConfig(SensorOptions):
    """Options of the fake."""

    noise: float = Field(default=0.0001, ge=0, description="m, standard deviation of a position along each axis")
    delay: float = Field(default=0.006, ge=0, le=0.5, description="s, from exposure to arrival; sent as the latency")
    bodies: dict[str, dict[str, str]] = Field(
        default_factory=dict, description="further subjects, SUBJECT: {SEGMENT: PART/BODY}, the root first; no markers"
    )
    occlusion: dict[str, Windows] = Field(
        default_factory=dict, description="SUBJECT or SUBJECT/MARKER: [from, to] pairs, s, while it can't be seen"
    )
    marker_dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a frame lacks a marker")
    reflections: tuple[Vector, ...] = Field(default=(), description="m: spots that are seen as unlabelled markers")


class Cameras(Sensor, SampledFake):
    """Sees every part of the cell that is a subject, and the bodies in the option `bodies`.

    A segment that has three markers or more is found if three of them are visible. The noise of
    orientations is that of markers 5 cm apart.
    """

    Options = CamerasConfig

    def __init__(self, name: str, config: CaptureConfig, world: World, options: CamerasConfig) -> None:
        super().__init__(name, config, world, options)
        self.wanted, self.seen_by = config, options
        place = f"sim.devices.{name}"
        if options.part is not None:
            parts = [self.cell.part(MocapSubject, name, options.part)]  # type: ignore[type-abstract]
        else:
            parts = [part for part in self.cell.parts.values() if isinstance(part, MocapSubject)]
        self.scene = scene = Scene(self.cell, parts, options.bodies, place, self.states[0].frame)
        per_pose = [1.0] * 3 + [0.5 / _LEVER] * 4
        self.noise_scale = np.array(per_pose * len(scene.segments) + [1.0] * 3 * len(scene.markers))
        self.sampled(scene.size, scene.take)
        self._windows = [(self._masks(scene, hidden, place), w) for hidden, w in options.occlusion.items()]
        dropout = options.marker_dropout
        self._marker_noise = SampleNoise(world.seed, f"{name}/markers", len(scene.markers), 1.0)
        self._drop_below = NormalDist().inv_cdf(dropout) if 0.0 < dropout < 1.0 else np.inf  # for a normal draw
        own = [(row, scene.carriers == row) for row in range(len(scene.segments))]
        self._enough = [(row, markers) for row, markers in own if int(markers.sum()) >= _ENOUGH]
        self._view = View(config)
        self._segments: list[tuple[int, int]] = []  # row of the states, row of the scene
        self._markers: list[tuple[int, int]] = []

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self._view.bind(states)

    def open(self) -> None:
        super().open()
        try:
            self._select()
        except DeviceError:
            self.close()
            raise

    def read(self, now: int) -> None:
        stamp = self.health.stamp
        super().read(now)
        if not self._view.seen:
            self.health.stamp = stamp

    def fill(self, values: Array, number: int) -> None:
        view = self._view
        poses, points = (found.tolist() for found in self.scene.split(values))
        segments, markers = (seen.tolist() for seen in self.visible(number))
        view.begin()
        for row, index in self._segments:
            if segments[index]:
                x, y, z, qw, qx, qy, qz = poses[index]
                view.segment(row, (x, y, z), (qw, qx, qy, qz))
        for row, index in self._markers:
            if markers[index]:
                x, y, z = points[index]
                view.marker(row, (x, y, z))
        for row, spot in enumerate(self.seen_by.reflections[: self.wanted.unlabelled]):
            view.reflection(row, spot)
        view.end(self.taken_at(number), round(self.max_age * 1e9))

    def offered(self, subjects: Sequence[Subject]) -> Sequence[Subject]:
        """The subjects by the names that the server gives them; their order and numbers stay."""
        return subjects

    @property
    def kept(self) -> int:
        """Number of the newest samples that are certainly still available."""
        return max(int(0.4 * self.seen_by.rate), 1)

    def visible(self, number: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which of the scene's segments and markers the cameras see in sample `number`; also used by the twin."""
        scene, at = self.scene, self.taken_at(number)
        segments, markers = np.ones(len(scene.segments), bool), np.ones(len(scene.markers), bool)
        for (hidden_segments, hidden_markers), windows in self._windows:
            if inside(windows, at):
                segments &= ~hidden_segments
                markers &= ~hidden_markers
        if self.seen_by.marker_dropout > 0.0:
            markers &= self._marker_noise.noise(number) >= self._drop_below
        if not markers.all():
            for row, own in self._enough:
                if int((own & markers).sum()) < _ENOUGH:
                    segments[row] = False
        return segments, markers

    def _select(self) -> None:
        config, scene = self.wanted, self.scene
        subjects = self.offered(scene.subjects)
        found = select(config, subjects)
        if found.missing:
            raise refuse(config, subjects, found.missing[0], self.name)
        self._segments = [
            (row, scene.segments.index((subject, segment)))
            for subject, rows in found.segments.items()
            for segment, row in rows.items()
        ]
        self._markers = [(row, scene.markers.index(marker)) for marker, row in found.markers.items()]

    @staticmethod
    def _masks(scene: Scene, name: str, place: str) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        masks = scene.masks(name)
        if masks is None:
            raise WiringError(
                f"{place}.occlusion.{name}", "no subject or marker has this name", nearest(name, scene.names())
            )
        return masks
