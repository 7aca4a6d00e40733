"""Round holes made of boxes, because MuJoCo's shapes are convex."""

from __future__ import annotations

from math import cos, pi, sin, tan
from xml.etree.ElementTree import Element

from srl.sim.parts.things.touch import FIXTURE_CONTACT
from srl.sim.world.mjcf import add

PIECES = 16


def add_rim(
    body: Element,
    name: str,
    centre: tuple[float, float, float],
    radius: float,
    outer: float,
    height: float,
    lean: float = 0.0,
) -> None:
    """Adds a ring of boxes about a hole along z. Inside it is a regular polygon about the circle of `radius`.

    Args:
        centre: m, of the hole, at half the height.
        radius, outer: m, of the hole, and of the boxes' outer faces.
        height: m, along z.
        lean: rad, angle at which the inner faces open upward (a chamfer); at the lower edge their distance is `radius`.
    """
    half = (outer - radius) / 2
    width = outer * tan(pi / PIECES)
    for k in range(PIECES):
        angle = 2 * pi * k / PIECES
        # The box leans about its lower inner edge, which keeps its place.
        out = radius + half * cos(lean) + height / 2 * sin(lean)
        up = -height / 2 - half * sin(lean) + height / 2 * cos(lean)
        c, s, cl, sl = cos(angle), sin(angle), cos(lean), sin(lean)
        add(
            body, "geom", name=f"{name}_{k}", type="box", size=(half, width, height / 2),
            pos=(centre[0] + out * c, centre[1] + out * s, centre[2] + up),
            xyaxes=(cl * c, cl * s, -sl, -s, c, 0.0),
            mass=0, rgba="0.6 0.6 0.62 1", **FIXTURE_CONTACT,
        )  # fmt: skip
