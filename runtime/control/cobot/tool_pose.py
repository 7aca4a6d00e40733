"""Pose, twist and Jacobian of the tool of an arm on a mobile base, in world axes."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from pydantic import Field

from runtime.contracts.controller import Controller, ControllerConfig
from runtime.contracts.signals import Signal
from runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, TWIST
from runtime.control.cobot.whole_body import BASE, PlaceConfig, RobotName, WholeBody, jacobian_signal
from runtime.control.robots import ARMS, SUMMIT_XL


class ToolPoseConfig(RobotName, ControllerConfig):
    """Options of `tool-pose`."""

    mount: PlaceConfig = Field(description="the arm's base in the mobile base's frame (at the height of the axles)")
    tool: PlaceConfig = Field(PlaceConfig(), description="the control point in the flange's frame")
    height: float = Field(
        SUMMIT_XL.wheel_radius, ge=0, description="m, of the mobile base's frame over the ground, where z is 0"
    )


class ToolPose(Controller):
    """Computes pose, twist and Jacobian of the tool from the measured states of arm and base.

    Inputs: `q` (n,) rad and `qd` (n,) rad/s of the arm; `base_pose` (3,) x, y (m), yaw (rad) in the world and
    `base_twist` (3,) vx, vy (m/s), wz (rad/s) in the base's own frame.

    Outputs, of the control point, world axes: `pose` (7,) m and w x y z; `twist` (6,) m/s and rad/s; `jacobian`
    (6, 3 + n), which maps the velocities of x, y (world), yaw and the joints to the twist.
    """

    Config = ToolPoseConfig
    summary = "pose, twist and Jacobian of the tool of an arm on a mobile base"

    def __init__(self, name: str, config: ToolPoseConfig) -> None:
        super().__init__(name, config)
        robot = ARMS[config.robot]
        n = robot.n
        self.inputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=robot.labels),
            Signal(name="qd", shape=(n,), unit="rad/s", labels=robot.labels),
            Signal(name="base_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name="base_twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),
        )
        self.outputs = (
            Signal(name="pose", shape=(7,), unit="m", labels=POSE, visual="path"),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", labels=TWIST),
            jacobian_signal(robot),
        )
        self._body = WholeBody(robot, config.mount.matrix(), config.tool.matrix(), config.height)
        self._q, self._v = np.zeros(BASE + n), np.zeros(BASE + n)

    def reset(self) -> None:
        self.update(0.0)

    def update(self, dt: float) -> None:
        q, v, body, out = self._q, self._v, self._body, self.output
        base = self.input["base_pose"]
        q[:BASE], q[BASE:] = base, self.input["q"]
        vx, vy, wz = self.input["base_twist"].tolist()
        yaw = base.item(2)
        c, s = cos(yaw), sin(yaw)
        v[:BASE], v[BASE:] = (c * vx - s * vy, s * vx + c * vy, wz), self.input["qd"]
        body.update(q)
        out["pose"][:] = *body.position, *body.orientation
        np.dot(body.jacobian, v, out["twist"])
        out["jacobian"][:] = body.jacobian
