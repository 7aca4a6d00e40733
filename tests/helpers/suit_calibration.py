"""A suit made of formulas, with a hidden heading and drift, on a person who does what a calibration says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.acted_calibration import Acted
from srl.commissioning.calibration.held_still import Kind
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.suit.method import ChannelMap, SuitMethod
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.wearer import Return, Walk
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, LINK_STALE

PROFILE = """
name: worn
rate: 5
devices:
  suit: {driver: noitom, port: "tcp://192.168.10.2:7001", calibration: p07.json}
controllers: []
sim: {world: cell, parts: {body: {part: body}}}
"""
BODY = Skeleton("axis-neuron")
QUICK = ("read=1.5", "hold=4", "walk=20", "stands=4")
_SWINGS = {"LeftUpLeg": 0.4, "RightUpLeg": -0.4, "LeftArm": -0.3, "RightArm": 0.3, "LeftForeArm": 0.2, "Spine": 0.05}


class Suited(Acted):
    """Rows of the suit.

    Attributes:
        heading: rad, by which its world is turned.
        drift: rad/s, by segment.
        tilted: rad about z, by stand and segment.
        faces: rad, by which the person faces otherwise, by stand.
        scatter: rad, SD of each segment's heading from stand to stand.
        pose: "n" or "t", that the person takes.
        frozen: segments that never turn in their parents; ("all",): the whole suit sends joints at rest.
        turns: whether the person turns in walking.
        gone: stands in which the link's last sample stays.
        step: the last that was begun.
    """

    channel_map: ChannelMap
    period, look = 200_000_000, 4

    def __init__(
        self, option: Sequence[str] = QUICK, heading: float = 0.6, drift: Mapping[str, float] | None = None,
        tilted: Mapping[tuple[int, str], float] | None = None, faces: Mapping[int, float] | None = None,
        scatter: float = 0.01, pose: str = "n", frozen: Sequence[str] = (), gone: Sequence[int] = (),
        turns: bool = True, person: str = "P07",
    ) -> None:  # fmt: skip
        request = CalibrationRequest("worn.yaml", "suit", person, option=option)
        super().__init__(SuitMethod, request, PROFILE, "suit")
        self.heading, self.drift, self.tilted, self.faces = heading, drift or {}, tilted or {}, faces or {}
        self.scatter, self.pose, self.frozen, self.gone, self.turns = scatter, pose, frozen, gone, turns
        self._random = np.random.default_rng(11)
        self._walks, self._yaw = False, 0.0
        self._off = np.zeros(len(BODY.names))

    def instruct(self, step: Any, instruction: Any) -> None:
        if isinstance(instruction, Walk | Return):
            self._walks = isinstance(instruction, Walk)
        if step.kind is Kind.GO:
            self._yaw = self.faces.get(step.number, 0.0)
            self._off = self._random.normal(0.0, self.scatter, len(BODY.names))

    def fill(self, row: Any) -> None:
        stand = self.step.number if self.step is not None else 0
        stale = stand in self.gone and self.step is not None and self.step.kind is not Kind.PAUSE
        row.devices[0, DEVICE.link] = LINK_CONNECTED | (LINK_STALE if stale else 0)
        if not stale:
            row.views["suit.rotation"][:] = self._rotations(stand)

    def _rotations(self, stand: int) -> Any:
        """(59, 4) w x y z, in the parents, as the suit sends them."""
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(BODY.names), 1))
        if self.frozen == ("all",):
            return still
        t = self._t / 5.0
        if self._walks and self.turns:
            self._yaw += 0.15
        own = np.zeros((len(BODY.names), 3))  # rotation vectors in the parents
        own[0, 1] = self._yaw
        for side, sign in (("Left", -1.0), ("Right", 1.0)):
            own[BODY.names.index(f"{side}Arm"), 2] = sign * (1.35 if self.pose == "n" else 0.1)
        for (number, name), by in self.tilted.items():
            if number == stand and not self._walks:
                own[BODY.names.index(name), 2] += by
        swing = 1.0 if self._walks else 0.005
        for i, name in enumerate(BODY.names):
            if name not in self.frozen:
                own[i, 0] += swing * _SWINGS.get(name, 0.1) * np.sin(3.0 * t + i)
        local = Rotation.from_rotvec(own).as_matrix()
        world = np.empty_like(local)
        wrong = Rotation.from_rotvec([[0.0, self._error(i, t), 0.0] for i in range(len(BODY.names))]).as_matrix()
        for i, up in enumerate(BODY.parents):
            world[i] = local[i] if up < 0 else world[up] @ local[i]
        sent = wrong @ world
        rel = [sent[i] if up < 0 else sent[up].T @ sent[i] for i, up in enumerate(BODY.parents)]
        return Rotation.from_matrix(rel).as_quat(scalar_first=True)

    def _error(self, i: int, t: float) -> float:
        """rad, of a joint's heading; one without a sensor goes with its parent."""
        name = BODY.names[i]
        if name in self.frozen:
            return self._error(BODY.parents[i], t)
        return self.heading + self.drift.get(name, 0.0) * t + float(self._off[i])
