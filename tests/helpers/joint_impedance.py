"""The law joint-impedance on the four-joint arm at the hip, and that arm's weight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from helpers.arm_urdf import HIP
from srl.control.arm.joint_impedance import JointImpedance, JointImpedanceConfig
from srl.runtime.contracts.files import KeptFile
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.testing import bound

ROBOT = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
K = {"yaw": 20.0, "shoulder": 25.0, "elbow": 12.0, "wrist": 4.0}
Q = np.array([0.3, 0.6, -0.8, 0.2])


def law(q: Any = Q, transforms: Any = None, **options: Any) -> JointImpedance:
    given = {"robot": ROBOT, "stiffness": K} | options
    made = bound(JointImpedance("arm", JointImpedanceConfig.model_validate(given)), transforms)
    made.input["q"][:] = q
    if "wanted" in made.input:
        made.input["wanted"][:] = q
    if "orientation" in made.input:
        made.input["orientation"][0] = 1.0
    return made


def weight(up: Any) -> np.ndarray:
    """(n,) N m, of the arm in the posture `Q`; `up`: in its base."""
    model = pinocchio_model(ROBOT, gravity=tuple(-9.81 * np.array(up)))
    found: np.ndarray = pin.computeGeneralizedGravity(model, model.createData(), Q)
    return found
