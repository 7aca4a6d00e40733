"""The cell's part `strap`: straps and flesh between a body and what is worn on it give way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, Self
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.rotation import Vector, composed, exp, inverted, log
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.sim.wearer.motion import quintic
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

Firmness = Literal["soft", "medium", "hard", "rigid"]
# N/m and N m/rad. Ours: an arm of 2 kg at 0.25 m, 5 N m, tilts it by 9, 4 and 2 degrees.
STIFFNESS: Final[dict[Firmness, tuple[float, float]]] = {
    "soft": (1000.0, 30.0),
    "medium": (2000.0, 70.0),
    "hard": (5000.0, 150.0),
    "rigid": (0.0, 0.0),
}


class Slip(BaseModel):
    """The plate's rest moves, as a strap that slides down a hip, or a buckle that jumps a notch."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: float = Field(ge=0, description="s, when it begins")
    lasts: float = Field(0.2, gt=0, description="s, until it has come to rest; ours")
    shift: Vector = Field((0.0, 0.0, 0.0), description="m, along the axes of where the plate stands without load")
    tilt: Vector = Field((0.0, 0.0, 0.0), description="rad, rotation vector in the same axes; less than half a turn")


class StrapConfig(PartConfig):
    """Options of the strap."""

    firmness: Firmness = Field("medium", description="sets the two stiffnesses below; rigid: no strap, a weld")
    translation: float | None = Field(None, gt=0, description="N/m, along each axis")
    rotation: float | None = Field(None, gt=0, description="N m/rad, about each axis")
    relaxation: float = Field(0.02, ge=0, description="s, damping over stiffness; ours")
    mass: float = Field(0.3, gt=0, description="kg, of the plate that is strapped on; ours")
    slip: Slip | None = Field(None, description="it slips once: {at, lasts, shift, tilt}; not of a rigid one")

    @model_validator(mode="after")
    def _can_slip(self) -> Self:
        if self.slip is not None and self.firmness == "rigid" and None in (self.translation, self.rotation):
            raise OptionError("a rigid strap can't slip", "Choose another `firmness`")
        return self


class StrapPart(Part):
    """Body `NAME/plate` on springs and dampers, on which what is worn is mounted.

    Without load it is where it stands. It turns about its own origin.

    Truth: `NAME_shift` (3,) m and `NAME_tilt` (3,) rad, a rotation vector, of the plate from where it stands without
    load, in the axes of where it stands.
    """

    Config = StrapConfig
    summary = "straps that give way, between a body and what is worn on it"

    def __init__(self, name: str, config: StrapConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        translation, rotation = STIFFNESS[config.firmness]
        self._springs = (config.translation or translation, config.rotation or rotation)
        self.truth = (
            Signal(name=f"{name}_shift", shape=(3,), unit="m", labels=POINT),
            Signal(name=f"{name}_tilt", shape=(3,), unit="rad", labels=POINT),
        )

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        plate = mjcf.body(parent, f"{name}/plate", **self.at())
        look = {"type": "box", "size": (0.06, 0.06, 0.004), "rgba": "0.25 0.25 0.28 1"}
        add(plate, "geom", name=f"{name}/plate", mass=config.mass, **look, **CONTACT["none"])
        translation, rotation = self._springs
        for axis, along in zip(POINT, np.eye(3), strict=True):
            self._spring(plate, axis, translation, type="slide", axis=along)
        self._spring(plate, "turn", rotation, type="ball")

    def _spring(self, plate: Element, which: str, stiffness: float, **joint: object) -> None:
        if stiffness:
            damping = stiffness * self._config.relaxation
            add(plate, "joint", name=f"{self.name}/{which}", stiffness=stiffness, damping=damping, **joint)

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        if self._config.slip is not None:
            self.every = 1
            self._slides = [int(model.joint(f"{self.name}/{axis}").qposadr[0]) for axis in POINT]
            turn = int(model.joint(f"{self.name}/turn").qposadr[0])
            self._turn = slice(turn, turn + 4)
        self._plate = int(model.body(f"{self.name}/plate").id)
        self._under = int(model.body_parentid[self._plate])
        self._stand = as_pose(np.concatenate([model.body_pos[self._plate], model.body_quat[self._plate]]))

    def drive(self, step: int) -> None:
        """Moves the springs' rest while the strap slips; a function of time only."""
        slip = self._config.slip
        if slip is None:
            return
        t = step * float(self._model.opt.timestep)
        share = quintic(min(max((t - slip.at) / slip.lasts, 0.0), 1.0))
        self._model.qpos_spring[self._slides] = share * np.array(slip.shift)
        self._model.qpos_spring[self._turn] = exp(*(share * angle for angle in slip.tilt))

    def rigid(self) -> Array:
        """(7,): where the plate would be without the strap, in the world: x y z (m), w x y z."""
        data, body = self._data, self._under
        under = as_pose(np.concatenate([data.xpos[body], data.xquat[body]]))
        return np.array(composed(under, self._stand))

    def fill(self, truth: Mapping[str, Array]) -> None:
        data, plate = self._data, self._plate
        now = as_pose(np.concatenate([data.xpos[plate], data.xquat[plate]]))
        x, y, z, *q = composed(inverted(as_pose(self.rigid())), now)
        shift, tilt = (truth[signal.name] for signal in self.truth)
        shift[:], tilt[:] = (x, y, z), log((q[0], q[1], q[2], q[3]))
