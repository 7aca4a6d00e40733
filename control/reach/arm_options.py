"""Options of the law `arm-reach`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from srl.control.cobot.robot_distances import DistancesConfig
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.per_element import Positive
from srl.runtime.models.robot_model import RobotOption


class ReachDistancesConfig(DistancesConfig):
    """Options under `distances`: obstacles and ground are in the arm's base frame, and stand."""

    ground: bool = Field(False, description="keep off the plane z = 0 of the arm's base frame as well")


class ArmReachConfig(ControllerConfig):
    """Options of `arm-reach`."""

    robot: RobotOption = Field(description="the arm: a robot of `models:`, or one of the runtime's")
    target: Literal["joints", "point", "pose"] = Field("joints", description="what a goal is")
    tool: str | None = Field(None, description="frame of the control point, on the arm's flange; null: the flange")
    command: Literal["position", "velocity"] = Field("position", description="what the device takes")
    distances: ReachDistancesConfig = ReachDistancesConfig()
    joint_speed: float = Field(0.5, gt=0, le=1, description="share of the robot's greatest joint speeds")
    acceleration: Positive = Field(2.0, description="rad/s^2 or m/s^2 of each joint, the most; the guard's or less")
    tolerance: Positive = Field(0.002, description="rad and m, within which a goal is still the same one")
    near: Positive = Field(
        0.003, description="rad or m: a velocity-commanded joint is at a corner or goal within this; what it resolves"
    )
    rotation_weight: Positive = Field(0.2, description="m: a rad of rotation counts as much as this")
    postures: int = Field(10, ge=1, le=200, description="postures that are looked at in a cycle, while it searches")
    max_postures: int = Field(5000, ge=10, description="of one search; then another starts")
    timeout: float = Field(0.2, gt=0, le=10, description="s without the measured joints after which the limb stops")
