"""A serial arm as a list of axes, revolute or prismatic: where its tip is, and how each axis moves it.

It uses plain numbers, as `srl.control.shared.kinematics` does.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from srl.runtime.contracts.options import Options
from srl.runtime.contracts.rotation import Quaternion, Vector, exp, product, turned

Finite = Annotated[float, Field(allow_inf_nan=False)]
Three = tuple[Finite, Finite, Finite]


class Axis(Options):
    """One axis and the link behind it, in the frame of the link before. At 0 all frames are parallel.

    In an arm that is one of the profile's `srl-arms`, `axis`, `link` and `slides` come from there.
    """

    axis: Three = Field((0.0, 0.0, 1.0), description="its direction; its length doesn't matter")
    link: Three = Field((0.0, 0.0, 0.0), description="m, from this axis to the next, or to the tip")
    slides: bool = Field(False, description="prismatic: it moves what follows along its direction, in m")
    lower: Finite = Field(-2.6, description="rad or m, least position that is asked of it")
    upper: Finite = Field(2.6, description="rad or m, greatest position that is asked of it")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if sum(v * v for v in self.axis) < 1e-6:
            raise ValueError("axis: it has no direction")
        if self.lower >= self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        return self


class Axes:
    """Forward kinematics and the positional Jacobian of a list of axes."""

    def __init__(self, axes: tuple[Axis, ...], first: Vector = (0.0, 0.0, 0.0)) -> None:
        """Args:
        axes: from the base to the tip.
        first: m, from the base to the first axis.
        """
        self._first = first
        self._axes: list[tuple[Vector, Vector, bool]] = []
        for axis in axes:
            x, y, z = axis.axis
            size = (x * x + y * y + z * z) ** 0.5
            self._axes.append(((x / size, y / size, z / size), axis.link, axis.slides))

    def forward(self, q: list[float]) -> tuple[Vector, list[Vector]]:
        """Returns the tip (m) in the base's frame, and how each axis moves it: n columns, m/rad or m/m.

        Args:
            q: (n,) rad or m.
        """
        turn: Quaternion = (1.0, 0.0, 0.0, 0.0)
        px, py, pz = self._first
        seen: list[tuple[Vector, Vector | None]] = []
        for (axis, link, slides), value in zip(self._axes, q, strict=True):
            ax, ay, az = along = turned(turn, axis)
            if slides:
                px, py, pz = px + value * ax, py + value * ay, pz + value * az
                seen.append((along, None))
            else:
                seen.append((along, (px, py, pz)))
                turn = product(turn, exp(value * axis[0], value * axis[1], value * axis[2]))
            lx, ly, lz = turned(turn, link)
            px, py, pz = px + lx, py + ly, pz + lz
        columns = []
        for (ax, ay, az), origin in seen:
            if origin is None:
                columns.append((ax, ay, az))
                continue
            dx, dy, dz = px - origin[0], py - origin[1], pz - origin[2]
            columns.append((ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx))
        return (px, py, pz), columns
