"""Options of a mobile base in the profile."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import Field, model_validator

from srl.drivers.zenoh_link import PeerConfig
from srl.runtime.contracts.per_element import PerElement, Positive
from srl.runtime.contracts.terms import PLANAR_TWIST

_TOPIC = re.compile(r"^[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*$")

# Limits of the controller on the robot (protocol sheet summit-xl-zenoh, section 1).
TOP_SPEED, TOP_TURN = 1.5, 3.0  # m/s, rad/s
TOP_ACCELERATION, TOP_TURN_ACCELERATION = 0.6, 1.5  # m/s^2, rad/s^2
# Sensible limits near people: the planner limits that the maker ships (fact sheet summit_xl_steel).
FORWARD, SIDEWAYS, TURN = 0.75, 0.5, 0.785  # m/s, m/s, rad/s

_OnTwist = Annotated[tuple[Positive, Positive, Positive], PerElement(PLANAR_TWIST)]


class BaseConfig(PeerConfig):
    """Options of a base. Defaults fit a SUMMIT-XL STEEL in the namespace `robot`.

    Topics are written as in ROS, without the leading slash. They are relative to `namespace` unless they begin
    with a slash.
    """

    namespace: str = Field("robot", description="the robot's ROS namespace; '' for none")
    middleware: Literal["bridge", "rmw_zenoh"] = Field(
        "bridge", description="zenoh-bridge-ros2dds, or a robot whose own middleware is zenoh"
    )
    domain: int = Field(0, ge=0, le=232, description="ROS domain, for rmw_zenoh")
    command: str = Field("cmd_vel", description="topic of the velocity command")
    message: Literal["Twist", "TwistStamped"] = Field("Twist", description="what the robot's controller takes")
    odometry: str = Field("robotnik_base_control/odom", description="topic of nav_msgs/Odometry")
    emergency: str | None = Field(
        "robotnik_base_hw/emergency_stop", description="topic of std_msgs/Bool, true: e-stop; null: none"
    )
    frame: str | None = Field(None, description="frame of the profile's tree in which the odometry gives the pose")
    child_frame: str | None = Field(
        None, description="the odometry's child_frame_id; null: any that ends in base_link or base_footprint"
    )
    sideways: bool = Field(True, description="mecanum wheels; false: skid steering, which can't move sideways")
    speed: _OnTwist = Field((FORWARD, SIDEWAYS, TURN), description="m/s, m/s, rad/s: largest vx, vy, wz")
    acceleration: _OnTwist = Field(
        (TOP_ACCELERATION, TOP_ACCELERATION, TOP_TURN_ACCELERATION), description="m/s^2, m/s^2, rad/s^2"
    )
    rate: float = Field(50.0, ge=10, le=200, description="Hz, commands at most")
    expiry: float = Field(
        0.2, ge=0.05, le=0.5, description="s; a command that no newer one has replaced is then followed by zero"
    )
    extrapolate: bool = Field(True, description="carry the pose on by the twist between two odometry messages")

    @model_validator(mode="after")
    def _possible(self) -> BaseConfig:
        tops = (TOP_SPEED, TOP_SPEED, TOP_TURN)
        for name, values, most in (
            ("speed", self.speed, tops),
            ("acceleration", self.acceleration, (TOP_ACCELERATION, TOP_ACCELERATION, TOP_TURN_ACCELERATION)),
        ):
            if any(value > top for value, top in zip(values, most, strict=True)):
                raise ValueError(f"{name}: the robot's own controller allows at most {list(most)}")
        if self.expiry * self.rate < 2.0:
            raise ValueError(f"expiry: at {self.rate:g} commands a second it must be at least {2 / self.rate:g} s")
        for name in ("command", "odometry", "emergency"):
            topic = getattr(self, name)
            if topic is not None and not _TOPIC.match(topic.removeprefix("/")):
                raise ValueError(f"{name}: '{topic}' isn't a ROS topic such as robotnik_base_control/odom")
        if self.namespace and not _TOPIC.match(self.namespace.strip("/")):
            raise ValueError(f"namespace: '{self.namespace}' isn't a ROS namespace such as robot")
        return self

    def topic(self, name: str) -> str:
        """Returns a topic's full name without the leading slash: the bridge's key expression."""
        if name.startswith("/"):
            return name[1:]
        space = self.namespace.strip("/")
        return f"{space}/{name}" if space else name
