"""A force/torque sensor made of formulas, with a hidden bias and tool, which a person turns as a calibration says."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.acted_calibration import Acted
from srl.commissioning.calibration.ft.method import ChannelMap, FtMethod
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts.wearer import Turn
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED

BIAS = np.array([3.0, -2.0, 1.0, 0.1, 0.2, -0.3])  # N, N m
MASS, COM = 0.45, np.array([0.004, -0.007, 0.053])  # kg, m
_SHIPPED = (files("srl.profiles") / "kairos-man.yaml").read_text()
PROFILE = re.sub(r"calibration: \{.*\}", "calibration: handle.json", _SHIPPED)
assert PROFILE != _SHIPPED


class Turner(Acted):
    """Rows of the sensor. What else may happen is by pose, from 1 on.

    Attributes:
        touched: N, along z of the world: somebody touches the tool in these poses.
        stays: poses in which the sensor stays as it was.
        lost: poses in which the sensor's link is gone, so that its last wrench stays.
        flat: it is turned about one axis alone.
        step: the last that was begun.
    """

    channel_map: ChannelMap

    def __init__(
        self, option: Sequence[str] = (), touched: dict[int, float] | None = None, stays: Sequence[int] = (),
        flat: bool = False, lost: Sequence[int] = (), mass: float = MASS, noise: float = 0.05,
    ) -> None:  # fmt: skip
        super().__init__(FtMethod, CalibrationRequest("led.yaml", "ft", option=option), PROFILE, "sensor")
        self.touched, self.stays, self.flat, self.mass, self.noise = touched or {}, stays, flat, mass, noise
        self.lost = lost
        self.turned = 0
        self._random, self._pose = np.random.default_rng(5), 0
        self._from = self._to = Rotation.identity()
        self._since = 0.0

    def instruct(self, step: Any, instruction: Any) -> None:
        self._pose = step.number
        if isinstance(instruction, Turn) and self._pose not in self.stays:
            self.turned += 1
            up = np.array(instruction.up) + self._random.normal(0.0, 0.1, 3)
            if self.flat:
                up = np.array([np.cos(self.turned), np.sin(self.turned), 0.0])
            self._from, self._since = self._to, self._t / 50.0
            self._to, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])

    def fill(self, row: Any) -> None:
        share = min((self._t / 50.0 - self._since) / 0.5, 1.0)
        turn = self._from * Rotation.from_rotvec(share * (self._from.inv() * self._to).as_rotvec())
        row.devices[0, DEVICE.link] = 0 if self._pose in self.lost else LINK_CONNECTED
        weight = turn.inv().apply([0.0, 0.0, -9.81 * self.mass])
        touch = turn.inv().apply([0.0, 0.0, self.touched.get(self._pose, 0.0)])
        wrench = np.concatenate([weight + touch, np.cross(COM, weight)]) + BIAS
        wrench += self._random.normal(size=6) * self.noise * [1.0, 1.0, 1.0, 0.02, 0.02, 0.02]
        row.views["sensor.wrench"][:] = wrench
