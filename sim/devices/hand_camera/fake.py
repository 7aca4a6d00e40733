"""A hand that a camera sees, in a simulated world: the hand's points, turned, off by noise, late, sometimes unseen."""

from __future__ import annotations

from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.hand_camera import HandCamera, HandCameraConfig
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.runtime.models.models import HandModel
from srl.runtime.models.point_series import PointSeries
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.parts.hand.human_hand import HumanHandPart

_AWAY: Final = np.array([0.05, -0.02, 0.5])  # m, of the wrist from the camera
SEEN: Final = 0.95  # confidence of a hand that is seen
UNSEEN: Final = 0.1


class FakeHandCameraOptions(SensorOptions):
    """Options of the fake; `noise` is m, of each coordinate."""

    rate: float = Field(default=30.0, gt=0, le=240, description="Hz, pictures")
    noise: float = Field(default=0.001, ge=0, description="m, standard deviation of each coordinate")
    delay: float = Field(default=0.05, ge=0, le=0.5, description="s, from the picture to the message")
    size: float = Field(default=1.1, gt=0, description="of the seen hand by the hand's: a camera sees no size")
    turning: float = Field(default=0.5, ge=0, le=3.0, description="rad, by which the hand turns before the camera")
    hidden: Windows = Field(default=(), description="s, [from, to] pairs in which no hand is found")


class FakeHandCamera(Sensor, SampledFake):
    """Measures the part `human-hand`, `part` or the only one."""

    Options = FakeHandCameraOptions
    real = HandCamera

    def __init__(self, name: str, config: HandCameraConfig, world: World, options: FakeHandCameraOptions) -> None:
        super().__init__(name, config, world, options)
        self.camera, self._options = config, options
        self.states = config.states()
        self._hand = self.cell.part(HumanHandPart, f"sim.devices.{name}", options.part)
        model: HandModel = self._hand.model
        self._points = PointSeries(*model.geometry())
        self.latency = round(config.latency * 1e9)
        self.sampled(20, self._hand.position)

    def landmarks(self, values: Array, number: int) -> Array:
        """(21, 3), m, in the camera's axes: of the joint angles (20,) of picture `number`."""
        own = np.vstack([np.zeros(3), self._points.at(values)])
        t = self.taken_at(number) * 1e-9
        a, b = self._options.turning * np.sin(0.7 * t), self._options.turning * np.cos(0.4 * t)
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        noise = np.random.default_rng([self.world.seed, number]).normal(0.0, 1.0, (21, 3))
        seen: Array = self._options.size * own @ (about_y @ about_x).T + _AWAY + self._options.noise * noise
        return seen

    def confidence(self, number: int) -> float:
        """Of picture `number`."""
        return UNSEEN if inside(self._options.hidden, self.taken_at(number)) else SEEN

    def arriving(self, number: int) -> Array:
        return self.samples[number].copy()

    def fill(self, values: Array, number: int) -> bool:
        if self.confidence(number) < self.camera.confidence:
            self.health.errors += 1
            return False
        self.state_arrays["landmarks"][:] = self.landmarks(values, number)
        self.state_arrays["confidence"][0] = self.confidence(number)
        self.state_arrays["right"][0] = float(self.camera.hand == "right")
        return True
