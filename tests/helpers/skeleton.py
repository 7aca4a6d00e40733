"""Human-SRL skeletons for tests, and an independent arm of Pinocchio's."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.models.models import ArmsModel

FILES = ("left_arm_fingers_yxz.bvh", "fullbody_walk_yxz.bvh", "fullbody_xyz.bvh")
FOLDER = "data/axis_neuron_bvh"
# The paper's configurations, and ours that moves the prismatic joint: rad, J5 in m.
ONE = np.zeros(7)
TWO = np.deg2rad([-50.0, -50.0, -30.0, 0.0, 0.0, 0.0, 50.0])
THREE = np.array([-0.6, -0.3, 0.4, 0.9, 0.08, -0.5, 0.2])


@cache
def human_srl(**options: Any) -> HumanSrl:
    """`options`: of the arms' model, as a profile's `models:` has them."""
    return HumanSrl(human(), ArmsModel(sides=("right", "left"), **options).arms)


def pinocchio_right_arm() -> Any:
    """The right arm, written down once more from the paper's axes and our sizes: joints at their own nodes, J5 last."""
    model = pin.Model()
    parent, at = 0, np.array([-0.10, -0.05, 0.20])
    for joint, step in (
        (pin.JointModelRX(), (-0.05, 0.0, 0.0)),
        (pin.JointModelRZ(), (-0.04, 0.0, 0.0)),
        (pin.JointModelRY(), (0.0, -0.05, 0.0)),
        (pin.JointModelRX(), (0.0, -0.19, 0.0)),
        (pin.JointModelPY(), (0.0, -0.06, 0.0)),
        (pin.JointModelRX(), (0.0, -0.13, 0.0)),
        (pin.JointModelRY(), (0.0, -0.04, 0.0)),
    ):
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), at + step), f"j{parent + 1}")
        at = np.zeros(3)
    end = pin.SE3(np.eye(3), np.array([0.0, -0.08, 0.0]))
    model.addFrame(pin.Frame("end", parent, 0, end, pin.FrameType.OP_FRAME))
    return model


def tip(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """The right arm's end in the frame of the spine, m, by Pinocchio; q as the law has it, J5 growing outward."""
    model = pinocchio_right_arm()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q * [1, 1, 1, 1, -1, 1, 1])
    return np.array(data.oMf[model.getFrameId("end")].translation)
