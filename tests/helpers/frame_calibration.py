"""An arm and motion capture made of formulas, with a hidden base and tracker, which a person leads as told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.acted_calibration import Acted
from srl.commissioning.calibration.frames.method import ChannelMap, FrameMethod
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts import rotation
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.wearer import Lead
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED

BASE: Pose = (1.2, -0.4, 0.8, *rotation.from_rpy(0.1, 0.0, 2.0))  # of the arm in the room
TRACKER: Pose = (0.03, 0.02, 0.05, *rotation.from_rpy(0.3, 0.2, 0.1))  # of what the cameras see, on the flange
POINTS = ("what=points", "frame_tip=0.03,0.02,0.05")  # options
PROFILE = """\
name: cell
rate: 100
devices:
  arm: {driver: panda, port: tcp://172.16.0.2:1337, interface: velocity}
  mocap: {driver: vicon, port: tcp://192.168.10.1:801, segments: {tool: tool/tool}, frame: room}
frames:
  room: {}
  arm: {parent: room, calibration: arm.json}
setpoints:
  client.velocity:
    {shape: [7], unit: rad/s, labels: [joint1, joint2, joint3, joint4, joint5, joint6, joint7], max_age: 0.2}
controllers:
  - use: velocity-setpoint
    name: jog
    axes: [joint1, joint2, joint3, joint4, joint5, joint6, joint7]
    in: {target: client.velocity}
    out: {velocity: arm.velocity_command}
guard:
  arm.velocity_command: {velocity: 0.3, acceleration: 1.0}
stop: {arm: hold}
faults: {bus-loss: hold}
sim:
  world: cell
  parts:
    arm: {part: panda, off_by: {position: [1.2, -0.4, 0.8], rpy: [0.1, 0.0, 2.0]}}
    ring: {part: ft-sensor, at: arm/flange, off_by: {position: [0.03, 0.02, 0.05], rpy: [0.3, 0.2, 0.1]}}
  devices:
    mocap: {bodies: {tool: {tool: ring/tool}}}
"""


class Leader(Acted):
    """Rows of arm and cameras. What else may happen is by number, from 1 on.

    Attributes:
        pushed: m, along x of the room: what the cameras see is off in these.
        blind: in these the cameras show zeros.
        lost: in these the cameras' link is gone, so that their last pose stays.
        flat: the arm turns about one axis alone; line: it goes along a line.
        scale: of the room's places.
        turning: rad/s, of what the cameras see, about its own origin.
        led: how often it was led elsewhere.
        step: the last that was begun.
    """

    channel_map: ChannelMap

    def __init__(
        self, option: Sequence[str] = (), pushed: dict[int, float] | None = None, lost: Sequence[int] = (),
        blind: Sequence[int] = (),
        flat: bool = False, line: bool = False, scale: float = 1.0, noise: float = 0.0001, base: Pose = BASE,
    ) -> None:  # fmt: skip
        super().__init__(FrameMethod, CalibrationRequest("cell.yaml", "frames", option=option), PROFILE, "")
        self.blind = blind
        self.pushed, self.lost, self.flat, self.line = pushed or {}, lost, flat, line
        self.scale, self.noise, self.base = scale, noise, base
        self.led = 0
        self._random, self._number = np.random.default_rng(5), 0
        self._from = self._to = np.array([0.5, 0.0, 0.4, 0.0, 0.0, 0.0])
        self._since = self.turning = 0.0

    def instruct(self, step: Any, instruction: Any) -> None:
        self._number = step.number
        if isinstance(instruction, Lead):
            self.led += 1
            self._from, self._since = self._to, self._t / 50.0
            random = np.random.default_rng((5, self._number, self.led))
            place = np.array([0.5, 0.0, 0.4]) + random.uniform(-0.3, 0.3, 3)
            turn = random.uniform(-1.0, 1.0, 3) * ([0.0, 0.0, 1.0] if self.flat else [1.0, 1.0, 1.0])
            if self.line:
                place[1:] = 0.0, 0.4
            self._to = np.concatenate([place, turn])

    def fill(self, row: Any) -> None:
        share = min((self._t / 50.0 - self._since) / 0.5, 1.0)
        at = self._from + share * (self._to - self._from)
        flange: Pose = (*at[:3].tolist(), *Rotation.from_rotvec(at[3:]).as_quat(scalar_first=True).tolist())
        names = self.graph.layout.devices
        for device in names:
            there = not (device == "mocap" and self._number in self.lost)
            row.devices[names.index(device), DEVICE.link] = LINK_CONNECTED if there else 0
        if "arm" in names:
            row.views["arm.pose"][:] = flange
        if self._number not in self.lost:
            tracker = rotation.composed(self.base, rotation.composed(flange, TRACKER))
            seen = np.array(tracker)
            seen[:3] = self.scale * (seen[:3] + self.noise * self._random.normal(size=3))
            seen[0] += self.pushed.get(self._number, 0.0)
            turned = Rotation.from_rotvec(10.0 * self.noise * self._random.normal(size=3))
            turned *= Rotation.from_rotvec([0.0, self.turning * self._t / 50.0, 0.0])
            seen[3:] = (Rotation.from_quat(seen[3:], scalar_first=True) * turned).as_quat(scalar_first=True)
            row.views["mocap.tool.pose"][:] = 0.0 if self._number in self.blind else seen
