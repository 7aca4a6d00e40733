"""The cell's part `carrier`: carries what is mounted on it to where it is told, as an ideal arm would."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.rotation import Pose, conjugate, exp, log, product
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POSE
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_UPDATE: Final = 0.002  # s between two targets


class CarrierConfig(PartConfig):
    """Options of the carrier; it begins where it stands."""

    mass: float = Field(
        default=1.7, gt=0, description="kg; that of an adult's forearm and hand, de Leva (1996): 2.2 % of 75 kg"
    )
    stiffness: float = Field(default=0.01, gt=0.002, le=1.0, description="s, in which it returns to its path; ours")


class CarrierPart(Part):
    """A weightless body `<name>/body` that goes from pose to pose with minimum jerk (Flash and Hogan 1985).

    It is welded softly to its path, so that what it holds moves it a little. It doesn't touch anything itself.

    Truth: `<name>_pose` (7,): x, y, z (m), w, x, y, z.
    """

    Config: ClassVar[type[PartConfig]] = CarrierConfig
    summary = "carries what is mounted on it to where a study tells it"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self.truth = (Signal(name=f"{name}_pose", shape=(7,), unit="m", labels=POSE),)
        self.every = 1

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        config, name = cast(CarrierConfig, self.config), self.name
        body = mjcf.body(mjcf.worldbody, f"{name}/body", gravcomp=1, **self.at())
        add(body, "freejoint", name=f"{name}/free")
        size = {"type": "capsule", "fromto": (0, -0.2, 0, 0, -0.03, 0), "size": 0.028}  # what is seen of the forearm
        add(body, "geom", name=f"{name}/arm", mass=config.mass, rgba="0.86 0.69 0.58 1", **size, **CONTACT["none"])
        mjcf.lead(name, f"{name}/body", config.stiffness, **self.at())

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._dt = data, float(model.opt.timestep)
        self._body = int(model.body(f"{self.name}/body").id)
        self._mocap = int(model.body(f"{self.name}/target").mocapid[0])
        self.every = max(1, round(_UPDATE / self._dt))
        self._from: Pose = self.stand
        self._to: Pose = self.stand
        self._since, self._seconds = 0.0, 0.0

    # -- what it is told

    def go(self, pose: Pose, seconds: float) -> None:
        """Goes from where its path is now to a pose in the world, x y z (m), w x y z, in this time."""
        self._from, self._to = self.path(self._data.time), pose
        self._since, self._seconds = float(self._data.time), seconds

    @property
    def there(self) -> bool:
        """Whether its path has ended."""
        return bool(self._data.time >= self._since + self._seconds)

    def path(self, t: float) -> Pose:
        """The pose on its path at t seconds of world time."""
        share = min((t - self._since) / self._seconds, 1.0) if self._seconds > 0.0 else 1.0
        s = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        x, y, z = ((1.0 - s) * a + s * b for a, b in zip(self._from[:3], self._to[:3], strict=True))
        start = self._from[3:]
        way = log(product(conjugate(start), self._to[3:]))
        return (x, y, z, *product(start, exp(*(s * v for v in way))))

    # -- the part

    def drive(self, step: int) -> None:
        pose = self.path((step + self.every) * self._dt)
        self._data.mocap_pos[self._mocap], self._data.mocap_quat[self._mocap] = pose[:3], pose[3:]

    def fill(self, truth: Mapping[str, Array]) -> None:
        out = truth[f"{self.name}_pose"]
        out[:3], out[3:] = self._data.xpos[self._body], self._data.xquat[self._body]

    def save(self) -> Array:
        return np.array([*self._from, *self._to, self._since, self._seconds])

    def restore(self, state: Array) -> None:
        values = state.tolist()
        self._from, self._to = tuple(values[:7]), tuple(values[7:14])
        self._since, self._seconds = values[14:]
