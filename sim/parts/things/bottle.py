"""The cell's part `bottle`: a bottle that stands, with a cap to unscrew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POSE
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_CAP_MASS: Final = 0.005  # kg
_INERTIA: Final = 1e-5  # kg m^2, of the thread's drag on the cap; it keeps so light a body well conditioned
_DAMPING: Final = 1e-2  # N m s/rad, the thread's; ours: a fifth more than the friction turns the cap at 1 rad/s


class BottleConfig(PartConfig):
    """Options of the bottle; it stands with the middle of its own height, z up, without the cap."""

    diameter: float = Field(default=0.075, gt=0, description="m")
    height: float = Field(default=0.15, gt=0, description="m, without the cap")
    mass: float = Field(default=0.3, gt=0, description="kg")
    friction: float = Field(default=0.8, gt=0, description="of bottle and cap against the pads of hand and finger")
    cap: tuple[float, float] = Field(default=(0.030, 0.025), description="m, the cap's diameter and height")
    torque: float = Field(default=0.03, ge=0, description="N m, that turns the cap: of one that was loosened; ours")


class BottlePart(Part):
    """A bottle that moves freely, and its cap, which turns against dry friction without coming off.

    Its body is `<name>/body`. Truth: `<name>_pose` (7,), m and w x y z; `<name>_cap` (1,) rad, the cap on the bottle.
    """

    Config: ClassVar[type[PartConfig]] = BottleConfig
    summary = "a bottle with a cap to unscrew"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self.truth = (
            Signal(name=f"{name}_pose", shape=(7,), unit="m", labels=POSE),
            Signal(name=f"{name}_cap", shape=(1,), unit="rad"),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(BottleConfig, self.config), self.name
        self.moves_freely(mjcf, parent)
        body = mjcf.body(parent, f"{name}/body", **self.at())
        add(body, "freejoint", name=f"{name}/joint")
        surface = {"priority": 1, "condim": 4, "friction": (config.friction, 0.005, 0.0001), **CONTACT["object"]}
        half = config.height / 2
        add(
            body, "geom", name=f"{name}/geom", type="cylinder", size=(config.diameter / 2, half), mass=config.mass,
            rgba="0.35 0.6 0.75 1", **surface,
        )  # fmt: skip
        across, high = config.cap
        cap = add(body, "body", name=f"{name}/cap", pos=(0, 0, half + high / 2))
        add(
            cap, "joint", name=f"{name}/cap", axis="0 0 1", frictionloss=config.torque, armature=_INERTIA,
            damping=_DAMPING,
        )  # fmt: skip
        add(
            cap, "geom", name=f"{name}/cap", type="cylinder", size=(across / 2, high / 2), mass=_CAP_MASS,
            rgba="0.8 0.35 0.3 1", **surface,
        )  # fmt: skip

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._body = data, int(model.body(f"{self.name}/body").id)
        self._cap = int(model.joint(f"{self.name}/cap").qposadr[0])

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose = truth[f"{self.name}_pose"]
        pose[:3], pose[3:] = self._data.xpos[self._body], self._data.xquat[self._body]
        truth[f"{self.name}_cap"][0] = self._data.qpos[self._cap]
