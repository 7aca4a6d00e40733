"""Pose, twist and Jacobian of the tool of an arm on a mobile base, in world axes."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from srl.control.cobot.whole_body import BASE, RobotName, WholeBody, jacobian_signal, mount_of_the_arm
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, TWIST
from srl.runtime.contracts.transforms import Transform, device, frame
from srl.runtime.models.robots.pinocchio_model import FLANGE


class ToolPoseConfig(RobotName, ControllerConfig):
    """Options of `tool-pose`."""

    gone: ClassVar[Mapping[str, str]] = {
        "mount": "write under `frames:` where the arm stands, as `arm: {parent: base, position: [...]}`",
        "height": "the mobile base's frame is on the ground now, so the arm's height in `frames:` is that over it",
    }

    tool: str = Field("tool", description="frame of the control point; it hangs on the arm's flange")


class ToolPose(Controller):
    """Computes pose, twist and Jacobian of the tool from the measured states of arm and base.

    The tree of frames says where the arm stands on the base, whose frame is on the ground, and where the control point
    is on the flange.

    Inputs: `q` (n,) rad and `qd` (n,) rad/s of the arm; `base_pose` (3,) x, y (m), yaw (rad) in the world and
    `base_twist` (3,) vx, vy (m/s), wz (rad/s) in the base's own frame.

    Outputs, of the control point, world axes: `pose` (7,) m and w x y z; `twist` (6,) m/s and rad/s; `jacobian`
    (6, 3 + n), which maps the velocities of x, y (world), yaw and the joints to the twist.
    """

    Config = ToolPoseConfig
    c_version = "srl.control.cobot.compiled_tool_pose:CompiledToolPose"
    summary = "pose, twist and Jacobian of the tool of an arm on a mobile base"

    def __init__(self, name: str, config: ToolPoseConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        n = robot.n
        self.inputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=robot.labels),
            Signal(name="qd", shape=(n,), unit="rad/s", labels=robot.labels),
            Signal(name="base_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name="base_twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),
        )
        self.outputs = (
            Signal(name="pose", shape=(7,), unit="m", frame="=base_pose", of=config.tool, labels=POSE, visual="path"),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", frame="=base_pose", of=config.tool, labels=TWIST),
            jacobian_signal(robot, frame="=base_pose", of=config.tool),
        )
        self.transforms = (
            mount_of_the_arm(),
            Transform("tool", frame(config.tool), device("q", FLANGE), "the control point in the flange's frame"),
        )
        self._robot = robot
        self._q, self._v = np.zeros(BASE + n), np.zeros(BASE + n)

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        mount, tool = rotation.homogeneous(self.transform["mount"]), rotation.homogeneous(self.transform["tool"])
        self._body = WholeBody(self._robot, mount, tool)

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
