"""Descriptions of robots, and their Pinocchio models (docs/robots.md)."""

from srl.runtime.models.robots import (
    FR3,
    PANDA,
    SUMMIT_XL,
    Capsule,
    Inertial,
    Joint,
    MecanumBase,
    Payload,
    RobotDescription,
)
from srl.runtime.models.robots.pinocchio_model import mobile_model, pinocchio_model

__all__ = [
    "FR3",
    "PANDA",
    "SUMMIT_XL",
    "Capsule",
    "Inertial",
    "Joint",
    "MecanumBase",
    "Payload",
    "RobotDescription",
    "mobile_model",
    "pinocchio_model",
]
