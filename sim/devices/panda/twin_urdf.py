"""The URDF that a simulated FR3 gives its clients, made from the runtime's own description of the arm.

Clients need seven joints called joint1 to joint7, `position_based_velocity_limits` beside each `limit`, inertias,
and a frame called exactly link8, the flange. If link8 is missing, libfranka 0.21 reads arbitrary memory.
Source: protocol sheet franka-fci, section 5.
"""

from __future__ import annotations

from functools import cache
from xml.etree.ElementTree import Element, tostring

from srl.runtime.contracts.rotation import euler_angles
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import FR3, PANDA
from srl.runtime.models.robots.description import Inertial
from srl.sim.devices.panda.motion import limits_of
from srl.sim.world.mjcf import add


@cache
def urdf(robot: str) -> str:
    """Returns the description of a `panda` or an `fr3`."""
    arm, limits = (FR3 if robot == "fr3" else PANDA), limits_of(robot)
    root = Element("robot", name=robot)
    _inertial(add(root, "link", name="link0"), arm.base)
    for i, joint in enumerate(arm.joints, 1):
        _inertial(add(root, "link", name=f"link{i}"), joint.link)
        element = _joint(root, i, "revolute", joint.placement)
        add(element, "axis", xyz=(0, 0, 1))
        add(
            element,
            "limit",
            lower=float(limits.lower[i - 1]),
            upper=float(limits.upper[i - 1]),
            velocity=float(limits.velocity[i - 1]),
            effort=float(limits.effort[i - 1]),
        )
        if limits.velocity_offset is not None and limits.deceleration is not None:
            offset, deceleration = float(limits.velocity_offset[i - 1]), float(limits.deceleration[i - 1])
            add(element, "position_based_velocity_limits", velocity_offset=offset, deceleration_limit=deceleration)
    add(root, "link", name="link8")
    _joint(root, 8, "fixed", arm.flange)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode")


def _joint(root: Element, number: int, kind: str, placement: Array) -> Element:
    joint = add(root, "joint", name=f"joint{number}", type=kind)
    rpy = euler_angles(placement[None, :3, :3], "ZYX")[0, ::-1]
    add(joint, "origin", xyz=placement[:3, 3].tolist(), rpy=rpy)
    add(joint, "parent", link=f"link{number - 1}")
    add(joint, "child", link=f"link{number}")
    return joint


def _inertial(link: Element, body: Inertial) -> None:
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=body.com.tolist(), rpy=(0, 0, 0))
    add(inertial, "mass", value=body.mass)
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    add(inertial, "inertia", **{name: float(body.inertia[at]) for name, at in pairs.items()})
