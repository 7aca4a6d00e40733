"""Makes Pinocchio models from robot descriptions."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pinocchio as pin

from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots.description import Inertial, Payload, RobotDescription
from srl.runtime.models.robots.mecanum import MecanumBase

FLANGE: Final = "flange"


def pinocchio_model(
    robot: RobotDescription,
    *,
    payload: Payload | None = None,
    gravity: tuple[float, float, float] = DOWN,
    rotors: bool = False,
) -> Any:
    """Makes a `pinocchio.Model` with the arm's n joints and the frame `flange`.

    Args:
        payload: a point mass at the flange.
        gravity: m/s^2, in the base frame.
        rotors: True if the mass matrix contains the rotors' inertia.
    """
    model = pin.Model()
    model.name = robot.name
    model.gravity.linear = np.array(gravity)
    last = add_arm(model, robot, 0, pin.SE3.Identity())
    if payload is not None:
        add_payload(model, payload)
    if rotors:
        model.armature = np.array(robot.rotor_inertia)
    assert last == robot.n
    return model


def mobile_model(
    base: MecanumBase,
    robot: RobotDescription,
    mount: Array,
    *,
    payload: Payload | None = None,
    gravity: tuple[float, float, float] = DOWN,
) -> Any:
    """Makes the model of an arm on a mobile base: q = (x, y, yaw, arm's joints), m and rad; frames `base`, `flange`.

    The base's velocities are along the world's axes, not along its own: rotate its twist by the yaw.

    Args:
        mount: (4, 4), the arm's base frame in the base's.
        payload: a point mass at the flange.
    """
    model = pin.Model()
    model.name = f"{base.name}-{robot.name}"
    model.gravity.linear = np.array(gravity)
    parent = 0
    for name, joint in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("yaw", pin.JointModelRZ())):
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), f"base_{name}")
    upright = np.diag([base.inertia, base.inertia, base.inertia])  # it only turns about z
    model.appendBodyToJoint(parent, pin.Inertia(base.mass, np.zeros(3), upright), pin.SE3.Identity())
    model.addFrame(pin.Frame("base", parent, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    add_arm(model, robot, parent, pin.SE3(np.array(mount)))
    if payload is not None:
        add_payload(model, payload)
    return model


def add_arm(model: Any, robot: RobotDescription, parent: int, placement: Any, prefix: str = "") -> int:
    """Adds an arm to a model behind joint `parent` and returns the number of its last joint.

    The names of the joints and of the frame `flange` get `prefix` in front.
    """
    if parent:
        model.appendBodyToJoint(parent, _inertia(robot.base), placement)
    for i, joint in enumerate(robot.joints):
        limits = [np.array([bound[i]]) for bound in (robot.tau_max, robot.dq_max, robot.q_lower, robot.q_upper)]
        kind = pin.JointModelPZ() if joint.slides else pin.JointModelRZ()
        parent = model.addJoint(parent, kind, placement * pin.SE3(joint.placement), prefix + joint.name, *limits)
        model.appendBodyToJoint(parent, _inertia(joint.link), pin.SE3.Identity())
        placement = pin.SE3.Identity()
    model.addFrame(pin.Frame(prefix + FLANGE, parent, 0, pin.SE3(robot.flange), pin.FrameType.OP_FRAME))
    return parent


def add_payload(model: Any, payload: Payload, flange: str = FLANGE) -> None:
    """Mounts a point mass at the flange."""
    frame = model.frames[model.getFrameId(flange)]
    load = pin.Inertia(payload.mass, np.array(payload.com), np.zeros((3, 3)))
    model.appendBodyToJoint(frame.parentJoint, load, frame.placement)


def _inertia(body: Inertial) -> Any:
    return pin.Inertia(body.mass, body.com, body.inertia)
