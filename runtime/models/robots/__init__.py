"""Descriptions of robots. Each is written once; the Pinocchio and MuJoCo models are made from it."""

from runtime.control.robots.description import Capsule, Inertial, Joint, Payload, RobotDescription
from runtime.control.robots.mecanum import SUMMIT_XL, MecanumBase
from runtime.control.robots.panda import FR3, PANDA
from runtime.control.robots.ur16e import UR16E

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
