"""Arms of bus servos as links with shapes, for pictures: worn arms of `models:`, and chains of a profile's axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.linkage import DARK, Color, Link, Linkage, Solid
from srl.runtime.contracts.rotation import Vector
from srl.runtime.models.skeleton.arms import Arms, Side

_SERVO: Final = (0.018, 0.018, 0.025)  # m, half sizes of a servo
_ROD: Final = 0.013  # m, radius of a link
_BLUE: Final[Color] = (70, 130, 200)


@dataclass(frozen=True)
class Axis:
    """One axis and the link behind it.

    Attributes:
        name: the element of the device's `position`.
        axis: in the frame of the link before, of any length.
        link: m, from this axis to the next, or to the tip.
        slides: in m along the axis; else it turns about it.
    """

    name: str
    axis: Vector
    link: Vector
    slides: bool = False


def chain(axes: Sequence[Axis], base: Vector = (0.0, 0.0, 0.0), first: Vector = (0.0, 0.0, 0.0)) -> Linkage:
    """A chain of axes; all frames are parallel where every axis is at zero.

    Args:
        axes: from the base on.
        base: m, the base in the device's own frame.
        first: m, from the base to the first axis.
    """
    links = [Link("base", -1, (*base, *IDENTITY[3:]), solids=(_servo((0.0, 0.0, 0.0)), *_rod(first)))]
    place = first
    for number, axis in enumerate(axes):
        last = number + 1 == len(axes)
        solids = (*_rod(axis.link), *(() if last else (_servo(axis.link),)))
        x, y, z = (np.array(axis.axis) / np.linalg.norm(axis.axis)).tolist()
        links.append(Link(axis.name, number, (*place, *IDENTITY[3:]), axis.name, (x, y, z), axis.slides, solids=solids))
        place = axis.link
    tip = Solid("sphere", (_ROD,), color=DARK)
    links.append(Link("tip", len(axes), (*place, *IDENTITY[3:]), solids=(tip,)))
    return Linkage(tuple(links))


def worn_arm(arms: Arms, side: Side) -> Linkage:
    """One of the supernumerary arms. The device's frame is that of the body's node on which it hangs."""
    base, first, *links = (tuple(row) for row in arms.offsets(side).tolist())
    axes = [
        Axis(name, tuple(axis), link, joint.slides)
        for name, axis, link, joint in zip(arms.labels, arms.axes(side).tolist(), links, arms.joints, strict=True)
    ]
    return chain(axes, base, first)


def _servo(at: Vector) -> Solid:
    return Solid("box", _SERVO, (*at, *IDENTITY[3:]), DARK)


def _rod(link: Vector) -> tuple[Solid, ...]:
    length = float(np.linalg.norm(link))
    if length < 1e-6:
        return ()
    x, y, z = (v / 2 for v in link)
    w, i, j, k = rotation.from_z(np.array(link)[None])[0].tolist()
    return (Solid("capsule", (_ROD, length / 2), (x, y, z, w, i, j, k), _BLUE),)
