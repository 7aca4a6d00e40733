"""MJCF of an arm from its description: bodies, joints, drives, contact shapes, flange."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import Capsule, Inertial, RobotDescription
from srl.sim.world.mjcf import FINGER_BIT, HAND_BIT, OBJECT_BIT, add
from srl.sim.world.part import Mjcf

ROBOT_BIT: Final = 8
_SHORT: Final = 1e-6  # m, below which MuJoCo finds no direction between a capsule's ends
POINT: Final = 1e-6  # m^2: inertia for each kg of a body that has none, as MuJoCo wants some
SPECK: Final = 1e-12  # kg and kg m^2, of a body without mass or inertia of its own
# Robots touch people and objects, but neither each other nor themselves.
ROBOT_CONTACT: Final = {"contype": ROBOT_BIT, "conaffinity": HAND_BIT | FINGER_BIT | OBJECT_BIT}


def add_arm(
    mjcf: Mjcf, parent: Element, robot: RobotDescription, name: str, damping: float, friction: float, **at: object
) -> Element:
    """Adds an arm; returns its body `<name>/flange`.

    Bodies are `<name>/base`, `<name>/<joint>` and `<name>/flange`; joints and drives are `<name>/<joint>`. A drive
    is a general actuator of gain 1; the part sets its bias. The drives compensate the gravity of the arm's own
    links, within each joint's greatest torque.

    Args:
        damping: damping of each joint, N m s/rad.
        friction: remaining share of the joints' dry friction. Sliding friction is the part's.
        at: attributes that place the base.
    """
    joints = {
        joint.name: {
            "armature": robot.rotor_inertia[i],
            "damping": damping,
            "frictionloss": friction * robot.dry_friction[i],
            "actuatorgravcomp": True,
            "actuatorfrcrange": (-robot.tau_max[i], robot.tau_max[i]),
        }
        for i, joint in enumerate(robot.joints)
    }
    flange = add_chain(mjcf, parent, robot, name, joints, at, gravcomp=1)
    for i, joint in enumerate(robot.joints):
        called, effort = f"{name}/{joint.name}", (-robot.tau_max[i], robot.tau_max[i])
        add(
            mjcf.actuator,
            "general",
            name=called,
            joint=called,
            gainprm=1,
            biastype="affine",
            biasprm=(0, 0, 0),
            forcerange=effort,
        )
    return flange


def add_chain(
    mjcf: Mjcf,
    parent: Element,
    robot: RobotDescription,
    name: str,
    joints: Mapping[str, Mapping[str, object]],
    at: Mapping[str, object] = MappingProxyType({}),
    gravcomp: int = 0,
) -> Element:
    """Adds an arm's bodies and joints, without drives; names as those of `add_arm`. Returns its body `<name>/flange`.

    Args:
        joints: by joint, its own attributes: armature, damping and so on.
        at: attributes that place the base.
        gravcomp: 1 if the drives compensate the links' gravity.
    """
    body = mjcf.body(parent, f"{name}/base", **at)
    if robot.base.mass > 0.0:
        add_inertial(body, robot.base)
    add_shape(body, robot.base_shape)
    for i, joint in enumerate(robot.joints):
        called, bounds = f"{name}/{joint.name}", (robot.q_lower[i], robot.q_upper[i])
        body = add(body, "body", name=called, gravcomp=gravcomp, **placed(joint.placement))
        if joint.link.mass > 0.0:
            add_inertial(body, joint.link)
        else:  # a link between two joints that meet in it
            add(body, "inertial", pos=(0, 0, 0), mass=SPECK, diaginertia=(SPECK, SPECK, SPECK))
        kind = {"type": "slide"} if joint.slides else {}
        ends = {"range": bounds} if np.isfinite(bounds).all() else {}  # one that turns without end has none
        add(body, "joint", name=called, axis=(0, 0, 1), **kind, **ends, **joints[joint.name])
        add_shape(body, joint.shape)
    flange = mjcf.body(body, f"{name}/flange", **placed(robot.flange))
    # If the flange had no mass, MuJoCo would apply external forces at a point other than its origin.
    add(flange, "inertial", pos=(0, 0, 0), mass=SPECK, diaginertia=(SPECK, SPECK, SPECK))
    return flange


def add_inertial(body: Element, inertial: Inertial) -> None:
    """Adds mass, centre of mass and inertia, in the body's frame. A point mass becomes a ball: see `POINT`."""
    inertia = inertial.inertia
    if inertial.mass > 0.0 and np.trace(inertia) < 1e-6 * POINT * inertial.mass:  # nothing, but for rounding
        inertia = POINT * inertial.mass * np.eye(3)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.tolist()
    add(body, "inertial", pos=inertial.com, mass=inertial.mass, fullinertia=(xx, yy, zz, xy, xz, yz))


def add_shape(body: Element, shape: tuple[Capsule, ...]) -> None:
    """Adds massless capsules that take part in contacts."""
    for capsule in shape:
        where: dict[str, object] = {"type": "capsule", "fromto": (*capsule.start, *capsule.end)}
        if np.allclose(capsule.start, capsule.end, atol=_SHORT):
            where = {"type": "sphere", "pos": capsule.start}
        add(body, "geom", **where, size=capsule.radius, mass=0, rgba="0.9 0.9 0.9 1", **ROBOT_CONTACT)


def placed(placement: Array) -> dict[str, object]:
    """Attributes that give a body the placement (4, 4) in its parent."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, placement[:3, :3].ravel())
    return {"pos": placement[:3, 3], "quat": quaternion}


def turned(alpha: float, length: float) -> dict[str, object]:
    """Attributes that place a body at the end of a standard Denavit-Hartenberg row: alpha (rad), a (m)."""
    return {"pos": (length, 0.0, 0.0), "quat": (np.cos(alpha / 2), np.sin(alpha / 2), 0.0, 0.0)}
