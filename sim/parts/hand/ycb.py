"""Eleven objects of the YCB set (Calli et al. 2015), as the IKNS paper lists them (Lisini Baldi et al. 2023, table I).

Masses and outer sizes are the paper's. Inertias are ours: solid boxes, spheres and cylinders; thin shells, open at the
top, for the cups. Friction against a silicone pad is a guess of ours by material.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Final, Literal
from xml.etree.ElementTree import Element

from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf

_SIDES: Final = 24  # of a cup's outline
_BASE: Final = 0.75  # of a cup's bottom, per rim: the cups of the set are stackable
# The wine glass, per greatest diameter or per height: ours, from pictures of the set.
_BOWL, _STEM, _FOOT, _FOOT_HEIGHT = 0.6, 0.05, 0.4, 0.02

Shape = Literal["box", "sphere", "cylinder", "cup", "glass"]


@dataclass(frozen=True)
class Ycb:
    """One object. Its frame is at the middle of its height, z up.

    Attributes:
        size: m; box: x, y, z; sphere: diameter; cylinder: diameter, height; cup: diameter of the rim, height; glass:
            greatest diameter, height.
        mass: kg.
        inertia: kg m^2, about the centre of mass.
        friction: against a silicone or rubber pad.
        centre: m, of mass, above the middle of its height.
        softness: s, time constant of its contacts.
    """

    name: str
    shape: Shape
    size: tuple[float, ...]
    mass: float
    inertia: tuple[float, float, float]
    friction: float
    centre: float = 0.0
    softness: float = 0.02

    @property
    def height(self) -> float:
        """m, as it stands."""
        return self.size[-1]


YCB: Final = {
    "A": Ycb("Rubik's cube", "box", (0.06, 0.06, 0.06), 0.084, (5.04e-5, 5.04e-5, 5.04e-5), 0.9),
    "B": Ycb("soft ball", "sphere", (0.096,), 0.191, (1.76e-4, 1.76e-4, 1.76e-4), 1.2, softness=0.03),
    "C": Ycb("chips can", "cylinder", (0.075, 0.25), 0.205, (1.14e-3, 1.14e-3, 1.44e-4), 0.8),
    "D": Ycb("tomato soup can", "cylinder", (0.066, 0.101), 0.349, (3.92e-4, 3.92e-4, 1.90e-4), 0.8),
    "E": Ycb("cup 1", "cup", (0.06, 0.062), 0.014, (1.14e-5, 1.14e-5, 1.14e-5), 0.8, centre=-0.0060),
    "F": Ycb("cup 2", "cup", (0.075, 0.068), 0.021, (2.36e-5, 2.36e-5, 2.63e-5), 0.8, centre=-0.0073),
    "G": Ycb("cup 3", "cup", (0.085, 0.072), 0.028, (3.81e-5, 3.81e-5, 4.48e-5), 0.8, centre=-0.0082),
    "H": Ycb("cup 4", "cup", (0.095, 0.076), 0.035, (5.68e-5, 5.68e-5, 6.96e-5), 0.8, centre=-0.0090),
    "I": Ycb("apple", "sphere", (0.075,), 0.068, (3.83e-5, 3.83e-5, 3.83e-5), 0.85),
    "L": Ycb("wine glass", "glass", (0.089, 0.137), 0.133, (2.40e-4, 2.40e-4, 6.45e-5), 0.75, centre=0.0069),
    "M": Ycb("potted meat can", "box", (0.05, 0.097, 0.082), 0.370, (4.97e-4, 2.84e-4, 3.67e-4), 0.8),
}


def add_shape(
    mjcf: Mjcf, body: Element, name: str, shape: Shape, size: tuple[float, ...], **attributes: object
) -> None:
    """Adds the geoms of a shape of this size (m) to a body: `<name>/geom`, and further ones where it isn't convex.

    Cups are solid truncated cones. The glass is an ellipsoid on a stem and a foot.
    """
    geom = f"{name}/geom"
    if shape == "cup":
        rim, height = size
        rings = ((-height / 2, _BASE * rim / 2), (height / 2, rim / 2))
        turns = [2 * pi * k / _SIDES for k in range(_SIDES)]
        corners = [(r * cos(turn), r * sin(turn), z) for z, r in rings for turn in turns]
        add(mjcf.asset, "mesh", name=geom, vertex=[v for corner in corners for v in corner])
        add(body, "geom", name=geom, type="mesh", mesh=geom, **attributes)
    elif shape == "glass":
        across, height = size
        bowl, foot = _BOWL * height / 2, _FOOT_HEIGHT * height / 2
        top = height / 2
        add(
            body, "geom", name=geom, type="ellipsoid", pos=(0, 0, top - bowl), size=(across / 2, across / 2, bowl),
            **attributes,
        )  # fmt: skip
        stem = (top - bowl * 2 + height / 2) / 2
        add(
            body, "geom", name=f"{name}/stem", type="cylinder", pos=(0, 0, stem - top), size=(_STEM * across, stem),
            **attributes,
        )  # fmt: skip
        add(
            body, "geom", name=f"{name}/foot", type="cylinder", pos=(0, 0, foot - top), size=(_FOOT * across, foot),
            **attributes,
        )  # fmt: skip
    else:
        add(body, "geom", name=geom, type=shape, size=tuple(v / 2 for v in size), **attributes)
