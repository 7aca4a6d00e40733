"""A motion-capture suit on a simulated person: what Axis Neuron broadcasts of the cell's part `body`."""

from __future__ import annotations

from math import cos, sin
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from srl.drivers.noitom import Noitom, NoitomConfig
from srl.drivers.noitom.pose import Pose
from srl.drivers.noitom.protocol import Frame
from srl.drivers.noitom.skeleton import JOINTS, is_finger
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.rotation import Quaternion, conjugate, euler_angles, matrices, product, turned
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.parts.body.body import BodyPart

_SIZE: Final = 3 + 4 * JOINTS  # position of the hips and the rotation of every joint; bones don't change
DECIMALS: Final = 4  # of the text format


class FakeNoitomConfig(SensorOptions):
    """Options of the fake."""

    rate: float = Field(default=60.0, gt=5, le=250, description="Hz, frames; 60 with 32 sensors, 120 with 17 or fewer")
    noise: float = Field(default=0.002, ge=0, description="rad, standard deviation of each joint about each axis")
    delay: float = Field(default=0.03, ge=0, le=0.5, description="s, from the pose to its frame's arrival")
    format: Literal["binary", "text"] = Field(default="binary", description="of the broadcast")
    displacement: bool = Field(default=True, description="every joint's translation is sent, not the hips' alone")
    reference: bool = Field(default=False, description="six zeros are sent ahead of the pose")
    gloves: bool = Field(default=True, description="fingers are measured; otherwise they stay as at the start")
    heading: float = Field(default=0.0, ge=-3.1416, le=3.1416, description="rad, by which its world is turned left")
    drift: dict[str, Annotated[float, Field(ge=-1, le=1)]] = Field(
        default_factory=dict,
        description="rad/s, by joint, by which its segment's heading drifts; fingers with the hand",
    )
    others: int = Field(default=0, ge=0, le=7, description="further avatars in the stream, in the T-pose")


class FakeNoitom(Sensor, SampledFake):
    """Gives the values that are sent: cm and degrees, with four decimals as text and as float32 in binary.

    Rotations are noisy. Translations aren't, because the software uses fixed bone lengths.
    """

    Options = FakeNoitomConfig
    real = Noitom

    def __init__(self, name: str, config: NoitomConfig, world: World, options: FakeNoitomConfig) -> None:
        super().__init__(name, config, world, options)
        self.suit, self.broadcast = config, options
        self.body = self.cell.part(BodyPart, name, options.part)
        if self.body.skeleton.kind != config.skeleton:
            raise WiringError(
                f"devices.{name}.skeleton",
                f"it is '{config.skeleton}', the person '{self.body.name}' has '{self.body.skeleton.kind}'",
                f"Give both the same: 'sim.parts.{self.body.name}.skeleton'",
            )
        self._pose = Pose(config, self.body.skeleton)
        self._fingers = np.array([is_finger(joint) for joint in self.body.skeleton.names])
        self._at_start = self.body.pose()[self._fingers, 3:].copy()
        # Each value of a quaternion gets half an angle of noise; normalising removes the part along the quaternion.
        scale = np.full((JOINTS, 4), 0.5)
        if not options.gloves:
            scale[self._fingers] = 0.0
        self.noise_scale = np.concatenate([np.zeros(3), scale.ravel()])
        self._translations = self.body.offsets.copy()
        self._drift = self._drifts()
        self.sampled(_SIZE, self._measure)

    def quantise(self, values: Array) -> Array:
        """The numbers of a frame: 354, 180, 360 or 186."""
        rotations = values[3:].reshape(JOINTS, 4)
        rotations = rotations / np.linalg.norm(rotations, axis=1)[:, None]
        self._translations[0] = values[:3]
        return self.frame(self._translations, np.degrees(euler_angles(matrices(rotations), self.suit.order)))

    def fill(self, values: Array, number: int) -> None:
        options = self.broadcast
        frame = Frame(values, options.displacement, options.reference, self.suit.avatar, "", number)
        self._pose.fill(frame, self.state_arrays)

    def frame(self, translations: Array, degrees: Array) -> Array:
        """The numbers that are sent for a pose: (59, 3) m and (59, 3) degrees in the configured order."""
        options = self.broadcast
        numbers: Array
        if options.displacement:
            numbers = np.hstack([100.0 * translations, degrees]).ravel()
        else:
            numbers = np.concatenate([100.0 * translations[0], degrees.ravel()])
        if options.reference:
            numbers = np.concatenate([np.zeros(6), numbers])
        if options.format == "text":
            return numbers.round(DECIMALS)
        return numbers.astype(np.float32).astype(np.float64)

    def metrics(self) -> dict[str, object]:
        """The frame rate, under the same key as the driver's."""
        return {"rate_hz": self.broadcast.rate}

    def _measure(self) -> Array:
        pose = self.body.pose()
        sample = np.concatenate([pose[0, :3], pose[:, 3:].ravel()])
        if not self.broadcast.gloves:
            sample[3:].reshape(JOINTS, 4)[self._fingers] = self._at_start
        if self.broadcast.heading or self.broadcast.drift:
            self._turn(sample)
        return sample

    def _drifts(self) -> list[float]:
        """rad/s of each joint's segment. Raises WiringError: there is no such joint."""
        skeleton, given = self.body.skeleton, self.broadcast.drift
        if unknown := [name for name in given if name not in skeleton.names]:
            place = f"sim.devices.{self.name}.drift"
            raise WiringError(place, f"there is no joint '{unknown[0]}'", nearest(unknown[0], skeleton.names))
        found: list[float] = []
        for joint, up in zip(skeleton.names, skeleton.parents, strict=True):
            found.append(given.get(joint, found[up] if is_finger(joint) else 0.0))
        return found

    def _turn(self, sample: Array) -> None:
        """Turns each segment of a sample about the vertical by its error now, as if each sensor had its own."""
        t, heading = self.world.time * 1e-9, self.broadcast.heading
        halves = [0.5 * (heading + rate * t) for rate in self._drift]
        errors: list[Quaternion] = [(cos(half), 0.0, sin(half), 0.0) for half in halves]
        true: list[Quaternion] = []  # of each joint in the suit's world
        rotations = sample[3:].reshape(JOINTS, 4)
        for i, up in enumerate(self.body.skeleton.parents):
            w, x, y, z = rotations[i].tolist()
            true.append((w, x, y, z) if up < 0 else product(true[up], (w, x, y, z)))
            if up < 0:
                rotations[i] = product(errors[i], true[i])
            elif self._drift[i] != self._drift[up]:
                rotations[i] = product(conjugate(product(errors[up], true[up])), product(errors[i], true[i]))
        x, y, z = sample[:3].tolist()
        sample[:3] = turned((cos(0.5 * heading), 0.0, sin(0.5 * heading), 0.0), (x, y, z))
