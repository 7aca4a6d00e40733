"""The objects that are grasped, and where they are put: spheres, cubes, pipes before a palm."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any, Final, Literal

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, from_rpy
from srl.runtime.contracts.signals import Array
from srl.sim.parts.hand.passive_hand import PALM_FACE
from srl.studies.grasp.measures import Contacts

Shape = Literal["sphere", "cube", "cylinder"]
SHAPES: Final[tuple[Shape, ...]] = ("sphere", "cube", "cylinder")
SIZES: Final = tuple(k / 1000 for k in range(40, 141, 20))
"""m: a sphere's or pipe's diameter, a cube's edge. The paper says "radius/edge"; the study runs both."""
FRICTION: Final = 0.8  # as of the parts `object`
PIPE: Final = 0.15  # m, length of a pipe: longer than the hand is wide; ours

# Where a hand takes it; ours. The centre is below the fingers' roots, between the fingertips and the extra finger.
_DISTAL: Final = (0.050, 0.090)  # m from the wrist: the fingers' roots are at 73 mm, the thumb's at 45
_SHIFT: Final = 0.010  # m, at most, across the palm
_GAP: Final = (0.008, 0.016)  # m between palm and object
_TURN: Final = np.deg2rad(20.0)  # at most, of a cube or pipe about the palm's normal


@dataclass(frozen=True)
class Thing:
    """One object. A pipe lies across the palm; its axis is its own z."""

    shape: Shape
    size: float

    @property
    def rms_radius(self) -> float:
        """m, root mean square of the distance of its surface from its centre."""
        a = self.size
        if self.shape == "sphere":
            return a / 2
        if self.shape == "cube":
            return a * sqrt(5 / 12)
        side, ends = pi * a * PIPE, pi * a**2 / 2
        return sqrt((side * (a**2 / 4 + PIPE**2 / 12) + ends * (PIPE**2 / 4 + a**2 / 8)) / (side + ends))

    @property
    def length(self) -> float:
        """m, by which torques are divided: contacts spread evenly over a sphere then have an isotropy of 1."""
        return sqrt(2 / 3) * self.rms_radius

    def part(self, position: Array, quaternion: Quaternion) -> dict[str, Any]:
        """The options of the cell's part `object`, held in place for ever."""
        shape, size = (
            ("sphere", [self.size]) if self.shape == "sphere"
            else ("box", [self.size] * 3) if self.shape == "cube"
            else ("cylinder", [self.size, PIPE])
        )  # fmt: skip
        at = {"position": [*map(float, position)], "quaternion": [*quaternion]}
        return {"part": "object", "shape": shape, "size": size, "mass": 0.1, "held_until": None, "at": at}

    def place(self, rng: np.random.Generator) -> tuple[Array, Quaternion]:
        """Draws where it is in the hand's frame: its centre (3,), m, and w x y z."""
        x, y = rng.uniform(-_SHIFT, _SHIFT), rng.uniform(*_DISTAL)
        gap, turn = rng.uniform(*_GAP), rng.uniform(-_TURN, _TURN)
        centre = np.array([x, y, -(PALM_FACE + gap + self.size / 2)])
        return centre, from_rpy(0.0, pi / 2 if self.shape == "cylinder" else 0.0, turn)

    def surface(self, rng: np.random.Generator, n: int) -> Contacts:
        """Draws n points evenly from its surface, in its own axes."""
        if self.shape == "sphere":
            out = rng.normal(size=(n, 3))
            out /= np.linalg.norm(out, axis=1, keepdims=True)
            return Contacts(self.size / 2 * out, -out)
        if self.shape == "cube":
            points = rng.uniform(-1.0, 1.0, (n, 3))
            out = np.zeros((n, 3))
            face, side = rng.integers(3, size=n), rng.choice([-1.0, 1.0], n)
            points[np.arange(n), face] = out[np.arange(n), face] = side
            return Contacts(self.size / 2 * points, -out)
        on_end = rng.uniform(size=n) < self.size / 2 / (PIPE + self.size / 2)
        turn, z = rng.uniform(0.0, 2 * pi, n), rng.uniform(-1.0, 1.0, n)
        end, share = rng.choice([-1.0, 1.0], n), np.sqrt(rng.uniform(size=n))
        across = np.column_stack([np.cos(turn), np.sin(turn)])
        points = np.column_stack([across * np.where(on_end, share, 1.0)[:, None], np.where(on_end, end, z)])
        out = np.where(on_end[:, None], np.column_stack([0 * turn, 0 * turn, end]), np.column_stack([across, 0 * turn]))
        return Contacts(points * [self.size / 2, self.size / 2, PIPE / 2], -out)
