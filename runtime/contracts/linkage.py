"""A robot as links with shapes: as much of it as a picture needs. The laws' models have the rest.

Links are in an order in which each comes after the one that it hangs on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.rotation import Pose, Vector
from srl.runtime.contracts.signals import Array

Color = tuple[int, int, int]
PLAIN: Color = (205, 205, 210)  # a link's
DARK: Color = (95, 100, 110)  # a joint's, a wheel's, a base's


@dataclass(frozen=True)
class Solid:
    """A shape in its link's frame.

    Attributes:
        kind: the shape.
        size: m: half sizes of a box; radius and half length along z of a cylinder and a capsule; radius of a sphere.
        pose: of its middle.
    """

    kind: Literal["box", "cylinder", "capsule", "sphere"]
    size: tuple[float, ...]
    pose: Pose = IDENTITY
    color: Color = PLAIN


@dataclass(frozen=True)
class Link:
    """A link and the joint before it.

    Attributes:
        parent: number of the link that it hangs on; -1: the robot's own frame.
        pose: of its frame in that one where the joint is at zero.
        joint: the element of the recorded angles that moves it; "": it is fixed.
        axis: of the joint, in the link's frame, of length 1.
        slides: along the axis, in m; else it turns about it, in rad.
        factor, offset: the joint is at factor times the element, plus offset (rad or m).
    """

    name: str
    parent: int
    pose: Pose = IDENTITY
    joint: str = ""
    axis: Vector = (0.0, 0.0, 1.0)
    slides: bool = False
    factor: float = 1.0
    offset: float = 0.0
    solids: tuple[Solid, ...] = ()


@dataclass(frozen=True)
class Linkage:
    """The links of one robot.

    Attributes:
        moving: numbers of the links that move in the one before.
    """

    links: tuple[Link, ...]
    moving: tuple[int, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "moving", tuple(i for i, link in enumerate(self.links) if link.joint))

    def moved(self, names: Sequence[str], values: Array) -> Array:
        """(k, m, 7): the poses of the m moving links, each in the frame of the link before.

        Args:
            names: (n) of the elements.
            values: (k, n), rad or m. Where one isn't a number, the pose isn't.
        """
        made = np.empty((len(values), len(self.moving), 7))
        for place, number in enumerate(self.moving):
            link = self.links[number]
            value = link.factor * values[:, names.index(link.joint)] + link.offset
            x, y, z, *turn = link.pose
            w, ax, ay, az = rotation.normalised((turn[0], turn[1], turn[2], turn[3]))
            made[:, place, :3] = x, y, z
            if link.slides:
                way = rotation.turned((w, ax, ay, az), link.axis)
                made[:, place, :3] += value[:, None] * way
                made[:, place, 3:] = w, ax, ay, az
            else:
                c, s = np.cos(value / 2), np.sin(value / 2)
                ux, uy, uz = (s * u for u in link.axis)
                made[:, place, 3:] = np.stack(
                    [w * c - ax * ux - ay * uy - az * uz, w * ux + ax * c + ay * uz - az * uy,
                     w * uy - ax * uz + ay * c + az * ux, w * uz + ax * uy - ay * ux + az * c], axis=1
                )  # fmt: skip
            made[~np.isfinite(value), place] = np.nan
        return made

    def placed(self, names: Sequence[str], values: Array) -> Array:
        """(n links, 4, 4): where each link is in the robot's own frame, m, at one set of values (n,)."""
        moved = dict(zip(self.moving, self.moved(names, values[None])[0], strict=True))
        places: list[Array] = []
        for number, link in enumerate(self.links):
            own = rotation.homogeneous(moved.get(number, np.array(link.pose)))
            places.append(own if link.parent < 0 else places[link.parent] @ own)
        return np.array(places)

    @classmethod
    def of(cls, links: Sequence[Mapping[str, Any]]) -> Linkage:
        """Makes it of JSON types, as `dataclasses.asdict` gave them. Raises ValueError, KeyError or TypeError."""
        made = []
        for number, given in enumerate(links):
            solids = tuple(
                Solid(s["kind"], tuple(map(float, s["size"])), tuple(map(float, s["pose"])), tuple(s["color"]))  # type: ignore[arg-type]
                for s in given["solids"]
            )
            link = Link(**{**given, "pose": tuple(given["pose"]), "axis": tuple(given["axis"]), "solids": solids})
            if not -1 <= link.parent < number or len(link.pose) != 7:
                raise ValueError(f"link '{link.name}' has no place")
            made.append(link)
        return cls(tuple(made))
