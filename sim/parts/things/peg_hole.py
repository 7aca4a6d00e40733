"""Experiment 3 of SUPER-MAN: a peg and a hole with a chamfer, in a block with a given stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any, Final, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE
from srl.sim.parts.things.rim import add_rim
from srl.sim.parts.things.touch import FIXTURE_CONTACT, Touches
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

_PERIOD: Final = 0.001  # s between two checks
_BLOCK: Final = 5.0  # kg; with its springs it oscillates at some 16 Hz, faster than anyone guides
_WALL: Final = 0.02  # m around the hole


class HoleConfig(PartConfig):
    """Options of the hole; its frame is in the middle of its mouth, z outward. The paper gives no dimensions: ours."""

    diameter: float = Field(default=0.031, gt=0, description="m; with the peg's 0.03 a clearance of 1 mm")
    depth: float = Field(default=0.05, gt=0, description="m, without the chamfer; it has no bottom")
    chamfer: float = Field(default=0.004, ge=0, description="m, height and width of a chamfer of 45 degrees")
    stiffness: float = Field(default=5e4, gt=0, description="N/m, of what the block stands on, in every direction")
    damping: float = Field(default=0.5, gt=0, description="damping ratio of the same")
    friction: float = Field(default=0.2, ge=0, description="between peg and hole")
    peg: str | None = Field(default=None, description="site of the peg's tip, such as peg/tip, for `depth`")


class HolePart(Part):
    """A block with the site `<name>/mouth`, on three springs, so that contact has the given stiffness.

    Truth: `<name>_force` (3,) N, of the peg on the block, world axes; `<name>_touches` (3,): number of touches, whether
    it is touched now, s of contact; `<name>_depth` (1,) m, of the peg's tip below the mouth while it is over the hole.
    """

    Config = HoleConfig
    summary = "a hole with a chamfer, in a block on springs; measures the force"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(HoleConfig, config)
        self.truth = (
            Signal(name=f"{name}_force", shape=(3,), unit="N", labels=FORCE),
            Signal(name=f"{name}_touches", shape=(3,), unit="1", labels=("count", "now", "seconds")),
            Signal(name=f"{name}_depth", shape=(1,), unit="m"),
        )
        self._tip: Any = None

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        body = mjcf.body(parent, f"{name}/block", gravcomp=1, **self.at())
        add(body, "inertial", pos=(0, 0, -config.depth / 2), mass=_BLOCK, diaginertia=(0.01, 0.01, 0.01))
        spring = {"stiffness": config.stiffness, "damping": 2 * config.damping * sqrt(config.stiffness * _BLOCK)}
        for axis, along in zip("xyz", np.eye(3).tolist(), strict=True):
            add(body, "joint", name=f"{name}/{axis}", type="slide", axis=along, **spring)
        r, c = config.diameter / 2, config.chamfer
        add_rim(body, f"{name}/wall", (0, 0, -c - config.depth / 2), r, r + _WALL, config.depth)
        if c:
            # Its lower inner edge is the upper one of the wall.
            add_rim(body, f"{name}/chamfer", (0, 0, -c + c / sqrt(2.0)), r, r + _WALL, c * sqrt(2.0), pi / 4)
            add_rim(body, f"{name}/top", (0, 0, -c / 2), r + c, r + c + _WALL, c)
        for geom in body.iter("geom"):
            geom.set("friction", f"{config.friction!r} 0.005 0.0001")
            geom.set("priority", "1")
            geom.set("solref", "0.004 1.0")
        add(body, "site", name=f"{name}/mouth", size=0.002)

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self.every = max(1, round(_PERIOD / float(model.opt.timestep)))
        self._dt = self.every * float(model.opt.timestep)
        self.touches = Touches(model, data, self.name)
        self._mouth = int(model.site(f"{self.name}/mouth").id)
        if (named := self._config.peg) is not None:
            sites = [model.site(i).name for i in range(model.nsite)]
            if named not in sites:
                raise WiringError(f"sim.parts.{self.name}.peg", f"no site is called '{named}'", nearest(named, sites))
            self._tip = data.site_xpos[model.site(named).id]

    def drive(self, step: int) -> None:
        self.touches.look(self._dt)

    @property
    def depth(self) -> float:
        """m, depth of the peg's tip below the mouth; 0 beside the hole."""
        if self._tip is None:
            return 0.0
        turn = self._data.site_xmat[self._mouth].reshape(3, 3)
        x, y, z = (turn.T @ (self._tip - self._data.site_xpos[self._mouth])).tolist()
        return max(-z, 0.0) if x * x + y * y < (self._config.diameter / 2 + self._config.chamfer) ** 2 else 0.0

    def fill(self, truth: Mapping[str, Array]) -> None:
        touches = self.touches
        truth[f"{self.name}_force"][:] = touches.force
        truth[f"{self.name}_touches"][:] = touches.count, touches.touching, touches.spent
        truth[f"{self.name}_depth"][0] = self.depth

    def save(self) -> Array:
        return np.array(self.touches.save())

    def restore(self, state: Array) -> None:
        self.touches.restore(state)


class PegConfig(PartConfig):
    """Options of the peg; its frame is at its upper end, and it points along z."""

    diameter: float = Field(default=0.03, gt=0, description="m; ours")
    length: float = Field(default=0.08, gt=0, description="m, with its round ends; ours")
    mass: float = Field(default=0.4, gt=0, description="kg; ours")


class PegPart(Part):
    """A peg with the body `<name>/peg` and the site `<name>/tip`. Its end is round, and it touches holes only."""

    Config = PegConfig
    summary = "a round peg"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(PegConfig, self.config), self.name
        body = mjcf.body(parent, f"{name}/peg", **self.at())
        r = config.diameter / 2
        add(
            body, "geom", name=f"{name}/peg", type="capsule", size=r, fromto=(0, 0, r, 0, 0, config.length - r),
            mass=config.mass, rgba="0.7 0.5 0.2 1", **FIXTURE_CONTACT,
        )  # fmt: skip
        add(body, "site", name=f"{name}/tip", pos=(0, 0, config.length), size=0.002)
