"""The contract of a part of the world `cell`: a robot, a sensor's mount, a person or an object."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts.signals import Array, Signal
from sim.world.mjcf import add


class PartConfig(BaseModel):
    """A part's options, under `sim.parts.<name>` next to the key `part`. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    on: str | None = Field(None, description="body it is mounted on, PART/BODY; None: the world")
    position: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="m, of its base in that body's frame")
    quaternion: tuple[float, float, float, float] = Field(
        (1.0, 0.0, 0.0, 0.0), description="w, x, y, z, of its base in that body's frame"
    )


class Mjcf:
    """The MJCF document under construction: its sections, to which parts add their elements.

    Attributes:
        bodies: every body added with `body`, by name, so that other parts can be mounted on it.
    """

    def __init__(self) -> None:
        self.asset, self.worldbody = Element("asset"), Element("worldbody")
        self.tendon, self.equality, self.contact = Element("tendon"), Element("equality"), Element("contact")
        self.actuator, self.sensor = Element("actuator"), Element("sensor")
        self.bodies: dict[str, Element] = {}

    def body(self, parent: Element, name: str, **attributes: object) -> Element:
        """Adds a body on which other parts can be mounted by name."""
        self.bodies[name] = body = add(parent, "body", name=name, **attributes)
        return body


class Part(ABC):
    """One part of the world.

    Order of calls: `__init__`, `build`, `bind`, then `drive` before steps; `fill` follows each advance.

    Attributes:
        name: its name in the profile; all its MJCF names begin with `<name>/`.
        truth: the true values, recorded as `world.<signal>`; their names begin with `<name>_`.
        every: number of physics steps between two calls of `drive`; 0: never called.
    """

    Config: ClassVar[type[PartConfig]] = PartConfig
    summary: ClassVar[str] = ""

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        self.name, self.config, self.seed = name, config, seed
        self.truth: tuple[Signal, ...] = ()
        self.every = 0

    @abstractmethod
    def build(self, mjcf: Mjcf, parent: Element) -> None:
        """Adds its elements; `parent` is the body (or worldbody) on which it is mounted."""

    def bind(self, model: Any, data: Any) -> None:
        """Looks up its addresses in the compiled `mujoco.MjModel` and sets its start values in `mujoco.MjData`.

        Parts are bound in the order of the profile. Afterwards the cell runs `mj_forward` once.
        """

    def drive(self, step: int) -> None:
        """Acts before physics step number `step`: sets `ctrl`, `qfrc_applied`, `xfrc_applied`, mocap poses."""

    def fill(self, truth: Mapping[str, Array]) -> None:
        """Fills its truth signals from the present state of the world."""

    def save(self) -> Array:
        """Its own state besides MuJoCo's (memory of the electronics, commands in transit), of fixed size."""
        return np.empty(0)

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""

    def at(self) -> dict[str, object]:
        """Attributes that place its base body where the profile mounts it."""
        return {"pos": self.config.position, "quat": self.config.quaternion}
