"""The contract of a part of the world `cell`: a robot, a sensor's mount, a person or an object."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from struct import Struct
from typing import Annotated, Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Discriminator, Field, Tag

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.frames import IDENTITY, Placement
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.rotation import Pose, composed
from srl.runtime.contracts.signals import Array, Signal
from srl.sim.world.mjcf import add


class Spot(Placement):
    """A place without a name, for what only the simulated world has."""

    parent: str | None = Field(None, description="a frame, or a part's body, PART/BODY; null: the world")


def _form(given: Any) -> str:
    """The form of `at:`, so that an error is about the form that was meant."""
    return "tagged-place" if isinstance(given, Mapping | Spot) else "tagged-name"


class PartConfig(Options):
    """A part's options, under `sim.parts.<name>` next to the key `part`. Unknown keys are errors."""

    gone: ClassVar[Mapping[str, str]] = {
        "on": "write `at: FRAME`, `at: PART/BODY` or `at: {parent: PART/BODY, position: [...]}`",
        "position": "write `at: FRAME` or `at: {position: [...]}`",
        "quaternion": "write `at: FRAME` or `at: {quaternion: [...]}`",
    }

    at: (
        Annotated[Annotated[str, Tag("tagged-name")] | Annotated[Spot, Tag("tagged-place")], Discriminator(_form)]
        | None
    ) = Field(
        None,
        description="frame of `frames:`, or a part's body, where it stands; null: the frame with its name, if there is "
        "one, else the world's origin",
    )
    off_by: Placement = Field(
        Placement(), description="where it stands in that frame: how far the world differs from what the profile says"
    )


class Mjcf:
    """The MJCF document under construction: its sections, to which parts add their elements.

    Attributes:
        bodies: every body added with `body`, by name, so that other parts can be mounted on it.
        carried: the frame that each part carries, by its name: the body that moves with it, and the frame's pose in
            that body. Unless the part says otherwise it is its first body.
    """

    def __init__(self) -> None:
        self.asset, self.worldbody = Element("asset"), Element("worldbody")
        self.tendon, self.equality, self.contact = Element("tendon"), Element("equality"), Element("contact")
        self.actuator, self.sensor = Element("actuator"), Element("sensor")
        self.bodies: dict[str, Element] = {}
        self.carried: dict[str, tuple[Element, Pose]] = {}

    def body(self, parent: Element, name: str, **attributes: object) -> Element:
        """Adds a body on which other parts can be mounted by name."""
        self.bodies[name] = body = add(parent, "body", name=name, **attributes)
        return body

    def lead(self, part: str, body: str, stiffness: float, **stand: object) -> None:
        """Welds a free body softly to the mocap body `PART/target`, which is where `stand` says.

        `stiffness`: s, in which the body returns to its target.
        """
        add(self.worldbody, "body", name=f"{part}/target", mocap=True, **stand)
        add(
            self.equality, "weld", name=f"{part}/weld", body1=f"{part}/target", body2=body,
            relpose=(0, 0, 0, 1, 0, 0, 0), solref=(stiffness, 1.0),
        )  # fmt: skip


class Part(ABC):
    """One part of the world.

    Order of calls: `__init__`, `build`, `bind`, then `drive` and `latch` before steps; `fill` follows each advance.

    A part that makes a simulated person has one more attribute, `wearer`: itself or another object with `instruct`,
    `done` and `see` (`srl.wearer.Wearer`). A calibration with `--sim` instructs the world's only one.

    Attributes:
        name: its name in the profile; all its MJCF names begin with `<name>/`.
        truth: the true values, recorded as `world.<signal>`; their names begin with `<name>_`.
        stand: where it stands in the body that `build` is given; the world sets it.
        carrier: the part that it stands on; "" for the world.
        every: number of physics steps between two calls of `drive`; 0: never called.
        settled: (1,) s, of which time the positions of bodies are; the world sets it, and all parts have the same one.
        warnings, remarks: (key of its options, text): what is probably wrong, and what a person should know.
        ends: s until the run ends by itself on the part's account, such as the end of a recording; None: never.
    """

    Config: ClassVar[type[PartConfig]] = PartConfig
    summary: ClassVar[str] = ""

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        self.name, self.config, self.seed = name, config, seed
        self.truth: tuple[Signal, ...] = ()
        self.every = 0
        self.stand: Pose = IDENTITY
        self.carrier = ""
        self.ends: float | None = None
        self.settled = [-1.0]
        self._set_of: Mapping[str, Array] | None = None  # what `_setters` set
        self._setters: list[Callable[..., None]] = []
        self.warnings: list[tuple[str, str]] = []
        self.remarks: list[tuple[str, str]] = []

    @abstractmethod
    def build(self, mjcf: Mjcf, parent: Element) -> None:
        """Adds its elements; `parent` is the body (or worldbody) on which it is mounted, at `self.at()`."""

    def moves_freely(self, mjcf: Mjcf, parent: Element) -> None:
        """For a part that moves freely: refuses to mount it on another one."""
        if parent is not mjcf.worldbody:
            problem = f"'{self.name}' moves freely, and can't be mounted on another part"
            raise WiringError(f"sim.parts.{self.name}.at", problem, "Let it stand in the world")

    def bind(self, model: Any, data: Any) -> None:
        """Looks up its addresses in the compiled `mujoco.MjModel` and sets its start values in `mujoco.MjData`.

        Parts are bound in the order of the profile. Afterwards the cell runs `mj_forward` once.
        """

    def drive(self, step: int) -> None:
        """Acts before physics step number `step`: sets `ctrl`, `qfrc_applied`, `xfrc_applied`, mocap poses."""

    def latch(self, step: int) -> int | None:
        """Applies what has come by physics step number `step`, and returns the step at which the next thing is due.

        For what happens at single instants, such as a servo's pulse. It is called after `drive`, at that step and
        maybe at others before it.
        """

    def fill(self, truth: Mapping[str, Array]) -> None:
        """Fills its truth signals from the present state of the world."""

    def setters(self, truth: Mapping[str, Array]) -> list[Callable[..., None]]:
        """For each of its truth signals, a function that sets it to plain numbers: a fifth of the time of numpy's."""
        if truth is not self._set_of:
            arrays = [truth[signal.name] for signal in self.truth]
            self._setters = [partial(Struct(f"{a.size}d").pack_into, a.data.cast("B"), 0) for a in arrays]
            self._set_of = truth
        return self._setters

    def save(self) -> Array:
        """Its own state besides MuJoCo's (memory of the electronics, commands in transit)."""
        return np.empty(0)

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""

    def at(self, inside: Pose = IDENTITY) -> dict[str, object]:
        """Attributes of a body that stands where the profile says, or has the pose `inside` there."""
        pose = composed(self.stand, inside)
        return {"pos": pose[:3], "quat": pose[3:]}
