"""Experiment 2 of SUPER-MAN: a plate overhead with holes, and a drill that must not touch it."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Any, Final, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE
from srl.sim.parts.things.rim import add_rim
from srl.sim.parts.things.touch import FIXTURE_CONTACT, Touches
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_PERIOD: Final = 0.001  # s between two checks


class PlateConfig(PartConfig):
    """Options of the plate; its frame is in its middle, at half its thickness, z up."""

    rows: int = Field(default=4, ge=1, le=20, description="along y; ours: the paper says 20 holes")
    columns: int = Field(default=5, ge=1, le=20, description="along x")
    spacing: float = Field(default=0.3, gt=0, description="m between the holes' middles; paper")
    diameter: float = Field(default=0.07, gt=0, description="m; paper")
    thickness: float = Field(default=0.02, gt=0, description="m; ours")
    drill: str | None = Field(default=None, description="site of the drill's tip, such as drill/tip, for `dwell`")


class PlatePart(Part):
    """A plate with sites `<name>/hole_0`, ... in the middle of the holes at its lower face, row by row, to and fro.

    Truth: `<name>_touches` (3,): number of touches, whether it is touched now, s of contact; `<name>_force` (3,) N, on
    it, world axes; `<name>_inside` (1,): the hole that contains the drill's tip, -1 for none; `<name>_dwell` (n,) s,
    for each hole the longest stay without a touch.
    """

    Config = PlateConfig
    summary = "a plate with holes to put a drill into; counts touches"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(PlateConfig, config)
        self.holes = _holes(config)
        n = len(self.holes)
        self.truth = (
            Signal(name=f"{name}_touches", shape=(3,), unit="1", labels=("count", "now", "seconds")),
            Signal(name=f"{name}_force", shape=(3,), unit="N", labels=FORCE),
            Signal(name=f"{name}_inside", shape=(1,), unit="1"),
            Signal(name=f"{name}_dwell", shape=(n,), unit="s", labels=tuple(f"hole_{k}" for k in range(n))),
        )
        self._inside, self._stay = -1, 0.0
        self._dwell = np.zeros(n)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        body = mjcf.body(parent, f"{name}/plate", **self.at())
        r, half, z = config.diameter / 2, config.spacing / 2, config.thickness / 2
        if half <= r * sqrt(2.0):
            raise WiringError(f"sim.parts.{name}.spacing", "the holes run into each other", "Set them farther apart")
        look: dict[str, object] = {"type": "box", "mass": 0, "rgba": "0.6 0.6 0.62 0.6", **FIXTURE_CONTACT}
        for k, (x, y) in enumerate(self.holes):
            # The rim covers the square about the hole; four strips cover the rest of the tile.
            add_rim(body, f"{name}/rim_{k}", (x, y, 0.0), r, r * sqrt(2.0), config.thickness)
            side = (half - r) / 2
            for j, (sx, sy) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
                at = (x + sx * (r + side), y + sy * (r + side), 0.0)
                size = (side, half, z) if sx else (r, side, z)
                add(body, "geom", name=f"{name}/tile_{k}_{j}", pos=at, size=size, **look)
            add(body, "site", name=f"{name}/hole_{k}", pos=(x, y, -z), size=0.002, group=4)

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self.every = max(1, round(_PERIOD / float(model.opt.timestep)))
        self._dt = self.every * float(model.opt.timestep)
        self.touches = Touches(model, data, self.name)
        self._plate = int(model.body(f"{self.name}/plate").id)
        self._tip: Any = None
        if (named := self._config.drill) is not None:
            sites = [model.site(i).name for i in range(model.nsite)]
            if named not in sites:
                raise WiringError(f"sim.parts.{self.name}.drill", f"no site is called '{named}'", nearest(named, sites))
            self._tip = data.site_xpos[model.site(named).id]

    def drive(self, step: int) -> None:
        self.touches.look(self._dt)
        if self._tip is None:
            return
        mujoco.mj_kinematics(self._model, self._data)
        turn = self._data.xmat[self._plate].reshape(3, 3)
        x, y, z = (turn.T @ (self._tip - self._data.xpos[self._plate])).tolist()
        inside = self._hole(x, y) if z > -self._config.thickness / 2 else -1
        if inside != self._inside or self.touches.touching:
            self._stay = 0.0
        elif inside >= 0:
            self._stay += self._dt
            self._dwell[inside] = max(self._dwell[inside], self._stay)
        self._inside = inside

    def _hole(self, x: float, y: float) -> int:
        radius = self._config.diameter / 2
        return next((k for k, (a, b) in enumerate(self.holes) if (x - a) ** 2 + (y - b) ** 2 < radius**2), -1)

    def fill(self, truth: Mapping[str, Array]) -> None:
        touches = self.touches
        truth[f"{self.name}_touches"][:] = touches.count, touches.touching, touches.spent
        truth[f"{self.name}_force"][:] = touches.force
        truth[f"{self.name}_inside"][0] = self._inside
        truth[f"{self.name}_dwell"][:] = self._dwell

    def save(self) -> Array:
        return np.array([*self.touches.save(), float(self._inside), self._stay, *self._dwell.tolist()])

    def restore(self, state: Array) -> None:
        self.touches.restore(state[: Touches.SIZE])
        self._inside, self._stay = int(state[Touches.SIZE]), float(state[Touches.SIZE + 1])
        self._dwell[:] = state[Touches.SIZE + 2 :]


def _holes(config: PlateConfig) -> tuple[tuple[float, float], ...]:
    out = []
    for row in range(config.rows):
        columns = range(config.columns) if row % 2 == 0 else reversed(range(config.columns))
        for column in columns:
            x, y = column - (config.columns - 1) / 2, row - (config.rows - 1) / 2
            out.append((x * config.spacing, y * config.spacing))
    return tuple(out)


class DrillConfig(PartConfig):
    """Options of the drill; its frame is at the machine's end, and the bit points along z."""

    mass: float = Field(default=5.0, gt=0, description="kg; paper")
    size: tuple[float, float] = Field(default=(0.08, 0.2), description="m, diameter and length of the machine; ours")
    bit: tuple[float, float] = Field(default=(0.02, 0.15), description="m, diameter and length of the bit; ours")


class DrillPart(Part):
    """A drill with the body `<name>/drill` and the site `<name>/tip`. Its bit touches plates only."""

    Config = DrillConfig
    summary = "a drill of 5 kg with a long bit"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(DrillConfig, self.config), self.name
        body = mjcf.body(parent, f"{name}/drill", **self.at())
        (wide, long), (thick, reach) = config.size, config.bit
        add(
            body, "geom", name=f"{name}/machine", type="cylinder", size=(wide / 2, long / 2), pos=(0, 0, long / 2),
            mass=config.mass, rgba="0.2 0.4 0.7 1", **CONTACT["none"],
        )  # fmt: skip
        add(
            body, "geom", name=f"{name}/bit", type="capsule", size=thick / 2,
            fromto=(0, 0, long, 0, 0, long + reach - thick / 2), mass=0, rgba="0.3 0.3 0.3 1", **FIXTURE_CONTACT,
        )  # fmt: skip
        add(body, "site", name=f"{name}/tip", pos=(0, 0, long + reach), size=0.002)
