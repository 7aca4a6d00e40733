"""The contract of a part of the world `cell`: a robot, a sensor's mount, a person, a thing."""

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
    """A part's options, under `sim.parts.<name>` beside `part`. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    on: str | None = Field(None, description="body it is mounted on, PART/BODY; None: the world")
    position: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="m, of its base in that body's frame")
    quaternion: tuple[float, float, float, float] = Field(
        (1.0, 0.0, 0.0, 0.0), description="w, x, y, z, of its base in that body's frame"
    )


class Mjcf:
    """The document under construction: its sections, to which parts add their elements.

    Attributes:
        bodies: every body added by name, so that others can be mounted on it.
    """

    def __init__(self) -> None:
        self.asset, self.worldbody = Element("asset"), Element("worldbody")
        self.tendon, self.equality, self.contact = Element("tendon"), Element("equality"), Element("contact")
        self.actuator, self.sensor = Element("actuator"), Element("sensor")
        self.bodies: dict[str, Element] = {}

    def body(self, parent: Element, name: str, **attributes: object) -> Element:
        """Adds a body on which other parts can be mounted by its name."""
        self.bodies[name] = body = add(parent, "body", name=name, **attributes)
        return body


class Part(ABC):
    """One part. Life: `__init__` -> `build` -> `bind` -> steps of `drive`; `fill` after each advance.

    Attributes:
        name: its name in the profile; all MJCF names begin with `<name>/`.
        truth: what really is, recorded as `world.<signal>`; names begin with `<name>_`.
        every: physics steps between two calls of `drive`; 0: never.
    """

    Config: ClassVar[type[PartConfig]] = PartConfig
    summary: ClassVar[str] = ""

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        self.name, self.config, self.seed = name, config, seed
        self.truth: tuple[Signal, ...] = ()
        self.every = 0

    @abstractmethod
    def build(self, mjcf: Mjcf, parent: Element) -> None:
        """Adds its elements; `parent` is the body (or worldbody) it is mounted on."""

    def bind(self, model: Any, data: Any) -> None:
        """Finds its addresses in the compiled `mujoco.MjModel` and sets its start in `mujoco.MjData`.

        Called in the order of the profile; afterwards the cell runs `mj_forward` once.
        """

    def drive(self, step: int) -> None:
        """Acts before physics step number `step`: sets `ctrl`, `qfrc_applied`, `xfrc_applied`, mocap poses."""

    def fill(self, truth: Mapping[str, Array]) -> None:
        """Fills its truth signals from the world as it is now."""

    def save(self) -> Array:
        """Own state besides MuJoCo's (what electronics remember, commands on their way); fixed size."""
        return np.empty(0)

    def restore(self, state: Array) -> None:
        """Goes back to what `save` gave."""

    def at(self) -> dict[str, object]:
        """Attributes that put its base body where the profile mounts it."""
        return {"pos": self.config.position, "quat": self.config.quaternion}
