"""Experiment 1 of SUPER-MAN: a bent rod along which a ring is moved without touching it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from math import cos, pi, sin
from typing import Any, Final, Literal, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field, field_validator

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import FORCE
from srl.sim.parts.person.path import ArcPath
from srl.sim.parts.things.touch import FIXTURE_CONTACT, Touches
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

_SEGMENT: Final = 0.02  # m, length of the rod's straight pieces
_SITES: Final = 0.02  # m between the sites of the path
_PERIOD: Final = 0.001  # s between two checks
# A path like Fig. 5a's: bends in all directions, 0.9 m from end to end. The paper gives no dimensions: ours.
_BENDS: Final = ((0.0, 0.0, 0.0), (0.12, 0.0, 0.05), (0.25, 0.06, 0.12), (0.38, 0.02, 0.08), (0.5, -0.06, 0.0),
                 (0.62, -0.02, -0.06), (0.75, 0.06, 0.02), (0.9, 0.0, 0.05))  # fmt: skip


class WireConfig(PartConfig):
    """Options of the wire."""

    points: tuple[tuple[float, float, float], ...] = Field(
        default=_BENDS, description="m, bends of the wire in the part's frame; a smooth curve goes through them"
    )
    radius: float = Field(default=0.003, gt=0, description="m, of the rod; ours")
    marks: tuple[float, ...] = Field(
        default=(0.25, 0.5, 0.75), description="shares of its length with a red mark; ours"
    )

    @field_validator("points")
    @classmethod
    def _two(cls, points: tuple[tuple[float, float, float], ...]) -> tuple[tuple[float, float, float], ...]:
        if len(points) < 2:
            raise ValueError("a wire needs two points at least")
        return points


class WirePart(Part):
    """A wire with sites `<name>/path_0`, `path_1`, ... along it and `<name>/mark_0`, ... at the marks.

    Truth: `<name>_touches` (3,): number of touches, whether it is touched now, s of contact; `<name>_force` (3,) N, on
    it, world axes.
    """

    Config = WireConfig
    summary = "a bent rod to lead a ring along; counts touches"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(WireConfig, config)
        self.truth = (
            Signal(name=f"{name}_touches", shape=(3,), unit="1", labels=("count", "now", "seconds")),
            Signal(name=f"{name}_force", shape=(3,), unit="N", labels=FORCE),
        )
        self.path = ArcPath(np.array(self._config.points, dtype=float), (1.0, 0.0, 0.0, 0.0), turning=True)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name, path = self._config, self.name, self.path
        body = mjcf.body(parent, f"{name}/rod", **self.at())
        ends = [path.at(path.length * k / n) for n in [max(int(path.length / _SEGMENT), 1)] for k in range(n + 1)]
        for k, (a, b) in enumerate(pairwise(ends)):
            add(
                body, "geom", name=f"{name}/piece_{k}", type="capsule", fromto=(*a[:3], *b[:3]), size=config.radius,
                rgba="0.5 0.5 0.55 1", **FIXTURE_CONTACT,
            )  # fmt: skip
        count = max(int(path.length / _SITES), 1)
        for k in range(count + 1):
            add(body, "site", name=f"{name}/path_{k}", pos=path.at(path.length * k / count)[:3], size=0.001, group=4)
        for k, share in enumerate(config.marks):
            at = path.at(path.length * share)[:3]
            add(body, "site", name=f"{name}/mark_{k}", pos=at, size=0.006, rgba="0.8 0.1 0.1 1")

    def bind(self, model: Any, data: Any) -> None:
        self.every = max(1, round(_PERIOD / float(model.opt.timestep)))
        self._dt = self.every * float(model.opt.timestep)
        self.touches = Touches(model, data, self.name)

    def drive(self, step: int) -> None:
        self.touches.look(self._dt)

    def fill(self, truth: Mapping[str, Array]) -> None:
        touches = self.touches
        truth[f"{self.name}_touches"][:] = touches.count, touches.touching, touches.spent
        truth[f"{self.name}_force"][:] = touches.force

    def save(self) -> Array:
        return np.array(self.touches.save())

    def restore(self, state: Array) -> None:
        self.touches.restore(state)


class RingConfig(PartConfig):
    """Options of the ring; its frame is at its centre."""

    diameter: float = Field(default=0.03, gt=0, description="m, inside; 3 cm in the paper")
    thickness: float = Field(default=0.003, gt=0, description="m; ours")
    axis: Literal["x", "y", "z"] = Field(default="x", description="which of its axes the wire goes through along")
    mass: float = Field(default=0.05, gt=0, description="kg; ours")
    pieces: int = Field(
        default=24, ge=8, le=64, description="straight pieces; inside, it is a polygon about the circle"
    )


class RingPart(Part):
    """A ring with the body `<name>/ring` and the site `<name>/centre`; it touches wires only.

    Mount it on the part that moves it.
    """

    Config = RingConfig
    summary = "a ring to be led along a wire"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(RingConfig, self.config), self.name
        body = mjcf.body(parent, f"{name}/ring", **self.at())
        add(body, "site", name=f"{name}/centre", size=0.002)
        around = config.diameter / 2 + config.thickness / 2
        corner = around / cos(pi / config.pieces)  # the middles of the pieces are on the circle
        turn = {"x": 0, "y": 1, "z": 2}[config.axis]
        ends = []
        for k in range(config.pieces + 1):
            angle = 2 * pi * k / config.pieces
            ends.append(np.roll([0.0, corner * cos(angle), corner * sin(angle)], turn))
        for k, (a, b) in enumerate(pairwise(ends)):
            add(
                body, "geom", name=f"{name}/piece_{k}", type="capsule", fromto=(*a, *b), size=config.thickness / 2,
                mass=config.mass / config.pieces, rgba="0.8 0.6 0.2 1", **FIXTURE_CONTACT,
            )  # fmt: skip
