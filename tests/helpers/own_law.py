"""A law and a sensor in a file beside their profile."""

from __future__ import annotations

from pathlib import Path

LAW = '''"""A law, a sensor, and what simulates it."""

from __future__ import annotations

import numpy as np
from srl import Controller, ControllerConfig, DeviceConfig, Sensor, Signal
from srl.simulation import Fake


class FollowConfig(ControllerConfig):
    gain: float = 0.5


class FollowTwice(Controller):
    Config = FollowConfig
    summary = "follows"

    def __init__(self, name: str, config: FollowConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="x", shape=(1,), unit="rad"),)
        self.outputs = (Signal(name="y", shape=(1,), unit="rad"),)

    def reset(self) -> None:
        self.update(0.0)

    def update(self, dt: float) -> None:
        if np.isfinite(self.input["x"][0]):
            self.output["y"][0] = self.config.gain * self.input["x"][0]


class KnobConfig(DeviceConfig):
    port: str = "none"


class Knob(Sensor):
    Config = KnobConfig
    summary = "a knob"
    gives = ("angle",)
    max_age = 0.1

    def __init__(self, name: str, config: KnobConfig) -> None:
        super().__init__(name, config)
        self.states = (Signal(name="angle", shape=(1,), unit="rad"),)

    def open(self) -> None:
        self.health.opened()

    def read(self, now: int) -> None:
        self.health.stamp = now

    def close(self) -> None:
        self.health.connected = False


class FakeKnob(Sensor, Fake):
    real = Knob

    def open(self) -> None:
        self.health.opened()

    def close(self) -> None:
        self.health.connected = False

    def read(self, now: int) -> None:
        self.state_arrays["angle"][0] = np.sin(self.world.time * 1e-9)
        self.health.stamp = now
        self.health.frames += 1
'''
PROFILE = """name: own-law
rate: 100
devices:
  knob: {driver: ./follow.py:Knob}
controllers:
  - use: ./follow.py:FollowTwice
    in: {x: knob.angle}
bus: null
sim: {world: cell, parts: {table: {part: box, size: [0.6, 0.6, 0.1]}}}
"""


def written(folder: Path, law: str = LAW, profile: str = PROFILE) -> Path:
    """Writes both into a folder, which is made. Returns the profile's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "follow.py").write_text(law)
    (folder / "own.yaml").write_text(profile)
    return folder / "own.yaml"
