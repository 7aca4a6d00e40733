"""A six-axis force/torque sensor between a body and what is mounted on it, and a handle to push."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import WRENCH
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

Vector6 = Annotated[tuple[Finite, Finite, Finite, Finite, Finite, Finite], PerElement(WRENCH)]
UNIT = "N, N m"


class FtSensorConfig(PartConfig):
    """Options of the part; the numbers are those of a common wrist sensor."""

    mass: float = Field(0.2, gt=0, description="kg, of the side that is mounted on the robot")
    plate_mass: float = Field(0.05, gt=0, description="kg, of the side that is measured: its own weight shows")
    height: float = Field(0.035, gt=0, description="m, from the mounting face to the measuring frame")
    radius: float = Field(0.04, gt=0, description="m")


class FtSensorPart(Part):
    """Bodies `NAME/base` and, on it, `NAME/tool`, whose frame is the measuring frame; mount objects on `NAME/tool`.

    It stands where its measuring frame is to be: at the frame that its device names.

    Truth: `NAME_wrench` (6,), N and N m: the wrench on the sensor from everything from the plate on, in the
    measuring frame, about its origin. A weight hanging along -z reads fz < 0.
    """

    Config = FtSensorConfig
    summary = "six-axis force/torque sensor"

    def __init__(self, name: str, config: FtSensorConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self.truth = (Signal(name=f"{name}_wrench", shape=(6,), unit=UNIT, labels=WRENCH),)
        self._measured: Array = np.zeros(6)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        half = config.height / 2
        base = mjcf.body(parent, f"{name}/base", **self.at((0.0, 0.0, -config.height, 1.0, 0.0, 0.0, 0.0)))
        look: dict[str, object] = {"type": "cylinder", "rgba": "0.6 0.6 0.65 1", **CONTACT["none"]}
        add(
            base, "geom", name=f"{name}/housing", size=(config.radius, half), pos=(0, 0, half), mass=config.mass, **look
        )
        tool = mjcf.body(base, f"{name}/tool", pos=(0.0, 0.0, config.height))
        mjcf.carried[name] = tool, IDENTITY
        add(tool, "geom", name=f"{name}/plate", size=(config.radius, 0.002), mass=config.plate_mass, **look)
        add(tool, "site", name=f"{name}/measure")
        add(mjcf.sensor, "force", name=f"{name}/force", site=f"{name}/measure")
        add(mjcf.sensor, "torque", name=f"{name}/torque", site=f"{name}/measure")

    def bind(self, model: Any, data: Any) -> None:
        self._data = data
        force, torque = (int(model.sensor(f"{self.name}/{what}").adr[0]) for what in ("force", "torque"))
        if torque != force + 3:
            raise AssertionError("MuJoCo keeps sensors in the order of the document")
        self._measured = data.sensordata[force : force + 6]

    @property
    def wrench(self) -> Array:
        """(6,) N, N m: see the class; from the last physics step."""
        return -self._measured  # MuJoCo gives the reaction, which holds the plate

    def fill(self, truth: Mapping[str, Array]) -> None:
        np.negative(self._measured, out=truth[self.truth[0].name])


class Push(BaseModel):
    """A period of time during which the handle is pushed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: float = Field(ge=0, description="s of world time")
    end: float = Field(description="s of world time")
    wrench: Vector6 = Field(description="N, N m; world axes, about the handle's centre")


class HandleConfig(PartConfig):
    """Options of the part."""

    mass: float = Field(0.15, gt=0, description="kg")
    length: float = Field(0.12, gt=0, description="m, along its z axis; its base is at one end")
    radius: float = Field(0.016, gt=0, description="m")
    pushes: tuple[Push, ...] = Field((), description="when it is pushed, and how; pushes that overlap add up")


class HandlePart(Part):
    """A handle with the body `NAME/grip`: a bar that a person holds, by script or by `push`.

    Truth: `NAME_push` (6,), N and N m, world axes, about the handle's centre.
    """

    Config = HandleConfig
    summary = "a handle that a simulated person pushes"

    def __init__(self, name: str, config: HandleConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self.truth = (Signal(name=f"{name}_push", shape=(6,), unit=UNIT, labels=WRENCH),)
        self.every = 1
        self._pushed: Array = np.zeros(6)
        self._applied: Array = np.zeros(6)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config = self._config
        half = config.length / 2
        body = mjcf.body(parent, f"{self.name}/grip", **self.at())
        add(
            body, "geom", name=f"{self.name}/bar", type="capsule", size=(config.radius, half), pos=(0, 0, half),
            mass=config.mass, rgba="0.2 0.2 0.2 1", **CONTACT["none"],
        )  # fmt: skip

    def bind(self, model: Any, data: Any) -> None:
        self._timestep = float(model.opt.timestep)
        self._applied = data.xfrc_applied[model.body(f"{self.name}/grip").id]

    def push(self, wrench: Array) -> None:
        """Pushes from the next physics step on, until the next call.

        Args:
            wrench: (6,) N, N m; world axes, about the handle's centre.
        """
        self._pushed[:] = wrench

    def drive(self, step: int) -> None:
        self._applied[:] = self._pushed
        at = step * self._timestep
        for push in self._config.pushes:
            if push.start <= at < push.end:
                self._applied += push.wrench

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[self.truth[0].name][:] = self._applied

    def save(self) -> Array:
        return self._pushed.copy()

    def restore(self, state: Array) -> None:
        self._pushed[:] = state
