"""The descriptions of arms, bases and fingers as links with shapes, for pictures."""

from __future__ import annotations

from math import pi

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.linkage import DARK, Color, Link, Linkage, Solid
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel
from srl.runtime.models.robots.description import Capsule, RobotDescription, rot_x, trans
from srl.runtime.models.robots.mecanum import MecanumBase

_PLATE = 0.004  # m, half of a flange's thickness
_WHEEL = 0.05  # m, half of a wheel's width
_MODULE = (0.0165, 0.008)  # m, half the width and half the thickness of a finger's module
_KNUCKLE = 0.009  # m, radius of a finger's servo
_FINGER: Color = (70, 130, 200)


def arm(robot: RobotDescription) -> Linkage:
    """A serial arm: its contact hulls, and a plate at the flange. Links: base, one a joint, flange."""
    links = [Link("base", -1, solids=_hulls(robot.base_shape, DARK))]
    for i, joint in enumerate(robot.joints):
        last = i + 1 == robot.n
        place = robot.flange if last else robot.joints[i + 1].placement
        neck = _neck(joint.shape, place, () if last else robot.joints[i + 1].shape)
        links.append(Link(joint.name, i, _pose(joint.placement), joint.name, solids=_hulls((*joint.shape, *neck))))
    radius = max((c.radius for c in robot.joints[-1].shape), default=0.03)
    plate = Solid("cylinder", (0.7 * radius, _PLATE), (0.0, 0.0, -_PLATE, 1.0, 0.0, 0.0, 0.0), DARK)
    links.append(Link("flange", robot.n, _pose(robot.flange), solids=(plate,)))
    return Linkage(tuple(links))


def base(robot: MecanumBase) -> Linkage:
    """A base on four wheels. Its frame is on the ground, below its middle."""
    length, width, height = robot.size
    box = Solid(
        "box", (length / 2, width / 2 - 2 * _WHEEL, height / 2),
        (0.0, 0.0, robot.clearance + height / 2, 1.0, 0.0, 0.0, 0.0), DARK,
    )  # fmt: skip
    ahead = Solid("box", (0.02, 0.1, 0.02), (length / 2, 0.0, robot.clearance + 0.75 * height, 1.0, 0.0, 0.0, 0.0))
    side = rotation.from_rpy(pi / 2, 0.0, 0.0)
    wheels = tuple(
        Solid("cylinder", (robot.wheel_radius, _WHEEL),
              (x * robot.half_length, y * (width / 2 - _WHEEL), robot.wheel_radius, *side), (60, 60, 65))
        for x in (1, -1) for y in (1, -1)
    )  # fmt: skip
    return Linkage((Link("base", -1, solids=(box, ahead, *wheels)),))


def finger(model: FingerModel) -> Linkage:
    """A finger of modules along x, with a knuckle at each joint."""
    links, place = [Link("base", -1, solids=(Solid("box", (0.012, 0.014, 0.012), IDENTITY, DARK),))], np.eye(4)
    for i, ((alpha, a), name) in enumerate(zip(model.rows, model.names, strict=True)):
        knuckle = Solid("cylinder", (_KNUCKLE, _MODULE[0]), IDENTITY, DARK)
        module = Solid("box", (max(abs(a) / 2 - 0.002, 0.002), _MODULE[1], _MODULE[0]),
                       (a / 2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), _FINGER)  # fmt: skip
        links.append(Link(name, i, _pose(place), name, solids=(knuckle, module) if a else (knuckle,)))
        place = trans(a, 0.0, 0.0) @ rot_x(alpha)
    links.append(Link("tip", len(model.rows), _pose(place), solids=(Solid("sphere", (_MODULE[1],), color=_FINGER),)))
    return Linkage(tuple(links))


def _neck(shape: tuple[Capsule, ...], place: Array, behind: tuple[Capsule, ...]) -> tuple[Capsule, ...]:
    """What closes the gap between a link's hulls and those of the next one, whose joint's frame is at `place`.

    It ends on the joint's axis, where the joint doesn't move it.
    """
    ends = [end for capsule in behind for end in (capsule.start, capsule.end)]
    on_axis = [np.zeros(3), *(np.array(end) for end in ends if abs(end[0]) + abs(end[1]) < 1e-6)]
    ways = []
    for capsule in shape:
        start, end = np.array(capsule.start), np.array(capsule.end)
        for point in ((place @ [*p, 1.0])[:3] for p in on_axis):
            along = end - start
            share = np.clip((point - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
            near = start + share * along
            ways.append((float(np.linalg.norm(point - near)), tuple(near.tolist()), tuple(point.tolist())))
    if not ways:
        return ()
    gap, start_, end_ = min(ways)
    radius = 0.85 * min(capsule.radius for capsule in (*shape, *behind))
    return (Capsule(start_, end_, radius),) if gap > 0.5 * radius else ()


def _hulls(shape: tuple[Capsule, ...], color: Color | None = None) -> tuple[Solid, ...]:
    made = []
    for capsule in shape:
        start, end = np.array(capsule.start), np.array(capsule.end)
        x, y, z = ((start + end) / 2).tolist()
        w, i, j, k = rotation.from_z((end - start)[None])[0].tolist()
        half = float(np.linalg.norm(end - start)) / 2
        solid = Solid("capsule", (capsule.radius, half), (x, y, z, w, i, j, k))
        made.append(solid if color is None else Solid(solid.kind, solid.size, solid.pose, color))
    return tuple(made)


def _pose(T: Array) -> Pose:
    x, y, z = T[:3, 3].tolist()
    return (x, y, z, *rotation.from_matrix(T[:3, :3]))
