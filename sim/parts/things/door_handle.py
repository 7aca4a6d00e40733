"""The cell's part `door-handle`: a lever that a spring holds up, on a door that stays shut."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POSE
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_DAMPING: Final = 0.01  # N m s/rad
_ARMATURE: Final = 1e-4  # kg m^2, of the lock


class DoorHandleConfig(PartConfig):
    """Options of the handle. It stands with its axle: x out of the door, the lever along y, z up."""

    length: float = Field(default=0.12, gt=0, description="m, of the lever")
    radius: float = Field(default=0.009, gt=0, description="m, of the lever's bar")
    distance: float = Field(default=0.05, gt=0, description="m, from the door to the bar's middle")
    start: float = Field(default=0.2, ge=0, description="N m, of the spring where the lever rests")
    end: float = Field(default=0.4, ge=0, description="N m, of the spring at `turn`")
    turn: float = Field(default=0.7, gt=0, lt=1.5, description="rad, down, at which the latch is free")
    friction: float = Field(default=0.6, gt=0, description="of the bar against the pads of hand and finger")


class DoorHandlePart(Part):
    """A lever on an axle, and the door's plane behind it, which nothing touches.

    Truth: `<name>_pose` (7,), m and w x y z, of the lever; `<name>_turn` (1,) rad, down.
    """

    Config: ClassVar[type[PartConfig]] = DoorHandleConfig
    summary = "a door's lever handle with its spring"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self.truth = (
            Signal(name=f"{name}_pose", shape=(7,), unit="m", labels=POSE),
            Signal(name=f"{name}_turn", shape=(1,), unit="rad"),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(DoorHandleConfig, self.config), self.name
        fixed = mjcf.body(parent, f"{name}/door", **self.at())
        door = {"type": "box", "size": (0.01, 0.25, 0.2), "pos": (-0.01, 0.0, 0.0), "rgba": "0.7 0.65 0.55 0.5"}
        add(fixed, "geom", name=f"{name}/door", **door, **CONTACT["none"])
        lever = add(fixed, "body", name=f"{name}/body")
        stiffness = (config.end - config.start) / config.turn
        # The spring is at rest where it would have no torque: above the stop that holds the lever up.
        rest = -config.start / stiffness if stiffness > 0.0 else 0.0
        add(
            lever, "joint", name=f"{name}/turn", axis="-1 0 0", range=(0.0, pi / 3), stiffness=stiffness,
            springref=rest, damping=_DAMPING, armature=_ARMATURE,
        )  # fmt: skip
        bar = {"type": "capsule", "size": config.radius, "rgba": "0.6 0.6 0.65 1"}
        add(
            lever, "geom", name=f"{name}/geom", mass=0.1, **bar, **CONTACT["object"], priority=1, condim=4,
            fromto=(config.distance, 0, 0, config.distance, config.length, 0), friction=(config.friction, 0.005, 1e-4),
        )  # fmt: skip
        neck = (0, 0, 0, config.distance, 0, 0)
        add(lever, "geom", name=f"{name}/neck", mass=0.05, **bar, **CONTACT["none"], fromto=neck)

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._body = data, int(model.body(f"{self.name}/body").id)
        self._turn = int(model.joint(f"{self.name}/turn").qposadr[0])

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose = truth[f"{self.name}_pose"]
        pose[:3], pose[3:] = self._data.xpos[self._body], self._data.xquat[self._body]
        truth[f"{self.name}_turn"][0] = self._data.qpos[self._turn]
