"""Descriptions of robots. Each is written once; the Pinocchio and MuJoCo models are made from it."""

from srl.runtime.models.robots.description import Capsule, Inertial, Joint, Payload, RobotDescription
from srl.runtime.models.robots.mecanum import SUMMIT_XL, MecanumBase
from srl.runtime.models.robots.panda import FR3, PANDA
from srl.runtime.models.robots.ur16e import UR16E

ARMS = {robot.name: robot for robot in (PANDA, FR3, UR16E)}

__all__ = [
    "ARMS",
    "FR3",
    "PANDA",
    "SUMMIT_XL",
    "UR16E",
    "Capsule",
    "Inertial",
    "Joint",
    "MecanumBase",
    "Payload",
    "RobotDescription",
]
