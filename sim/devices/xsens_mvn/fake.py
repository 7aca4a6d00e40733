"""An Xsens suit on a simulated person, and what MVN makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.capture.names import Point
from srl.drivers.capture.view import View
from srl.drivers.xsens_mvn import MvnConfig, XsensMvn
from srl.drivers.xsens_mvn.config import signals
from srl.drivers.xsens_mvn.protocol import JOINT_ENDS, SEGMENTS
from srl.runtime.contracts import rotation
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.frames import IDENTITY, as_pose
from srl.runtime.contracts.rotation import Quaternion
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.xsens_mvn.worn import places
from srl.sim.parts.body.body import BodyPart
from srl.sim.parts.body.upper_body import UpperBodyPart

COUNT: Final = len(SEGMENTS)
_ISB: Final = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x forward, y left, z up as x forward, y up, z right


class FakeMvnConfig(SensorOptions):
    """Options of the fake; those from `datagrams` on are for the twin's stream."""

    rate: float = Field(default=60.0, gt=5, le=240, description="Hz, samples")
    noise: float = Field(default=0.005, ge=0, description="rad, standard deviation of each segment about each axis")
    delay: float = Field(default=0.03, ge=0, le=0.5, description="s, from the pose to its datagram's arrival")
    datagrams: int = Field(default=1, ge=1, le=4, description="over which the segments of a sample are spread")
    others: int = Field(default=0, ge=0, le=3, description="further characters in the stream, who stand still")
    y_up: bool = Field(
        default=False, description="MVN's y axis is up and its z axis forward, whatever the profile says"
    )
    old: bool = Field(default=False, description="headers as before MVN 2019")


class FakeMvn(Sensor, SampledFake):
    """Measures the part `body` or `upper-body`. The trunk of the latter is one piece, and its legs hang from it.

    Orientations are noisy; positions aren't, because MVN's segments have fixed lengths. Joint angles are those of the
    noisy segments, in the order ZXY of the axes of the International Society of Biomechanics.
    """

    Options = FakeMvnConfig
    real = XsensMvn

    def __init__(self, name: str, config: MvnConfig, world: World, options: FakeMvnConfig) -> None:
        super().__init__(name, config, world, options)
        self.mvn, self.stream = config, options
        person = self._person(name, options.part)
        model = self.cell.model
        worn = places(person)
        self._bodies = np.array([model.body(body).id for body, _ in worn], np.intp)
        self._local = [pose for _, pose in worn]
        self._root = int(model.body(worn[0][0]).id)
        self._frame = config.frame if config.frame in self.cell.frames.entries else None
        self._view = View(config)
        self._names = {signal.name for signal in signals(config)}
        self._rows = [(row, SEGMENTS.index(of)) for row, of in enumerate(config.segments.values())]
        self.noise_scale = np.concatenate([np.tile([0.0] * 3 + [0.5] * 4, COUNT), np.zeros(3)])
        self.sampled(7 * COUNT + 3, self._measure)

    def _person(self, name: str, part: str | None) -> BodyPart | UpperBodyPart:
        persons = [p for p in self.cell.parts.values() if isinstance(p, BodyPart | UpperBodyPart)]
        if part is not None:
            persons = [p for p in persons if p.name == part]
        if len(persons) != 1:
            problem = f"the cell has {len(persons)} persons for the suit"
            raise WiringError(f"sim.devices.{name}.part", problem, "Name one part 'body' or 'upper-body'")
        return persons[0]

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self._view.bind(states)
        for extra in ("joint_angles", "centre_of_mass"):
            if extra in states:
                states[extra].fill(np.nan)

    def quantise(self, values: Array) -> Array:
        """As single precision, with quaternions of length 1."""
        poses = values[: 7 * COUNT].reshape(COUNT, 7)
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        return values.astype(np.float32).astype(np.float64)

    def fill(self, values: Array, number: int) -> None:
        view = self._view
        poses, centre = self.split(values)
        view.begin()
        for row, index in self._rows:
            place, turn = posed(poses[index])
            view.segment(row, place, turn)
        view.end(self.taken_at(number), round(self.max_age * 1e9))
        if "joint_angles" in self._names:
            of = dict(zip(JOINT_ENDS, self.angles(poses), strict=True))
            for row, joint in enumerate(self.mvn.joints):
                self.state_arrays["joint_angles"][row] = [radians(a) for a in of[joint]]
        if "centre_of_mass" in self._names:
            self.state_arrays["centre_of_mass"][:] = centre

    @staticmethod
    def split(values: Array) -> tuple[Array, Array]:
        """A sample's poses (23, 7) and centre of mass (3,), m."""
        return values[: 7 * COUNT].reshape(COUNT, 7), values[7 * COUNT :]

    @staticmethod
    def angles(poses: Array) -> Array:
        """(22, 3), degrees: about x, y, z of each joint, in the protocol's order."""
        R = _ISB @ rotation.matrices(poses[:, 3:]) @ _ISB.T
        parents, children = (np.array(ends) - 1 for ends in zip(*JOINT_ENDS.values(), strict=True))
        zxy = np.degrees(rotation.euler_angles(R[parents].transpose(0, 2, 1) @ R[children], "ZXY"))
        found: Array = zxy[:, [1, 2, 0]]
        return found

    def _measure(self) -> Array:
        data = self.cell.data
        at = np.hstack([data.xpos[self._bodies], data.xquat[self._bodies]])
        poses = [rotation.composed(as_pose(body), own) for body, own in zip(at, self._local, strict=True)]
        centre = data.subtree_com[self._root].copy()
        if self._frame is not None and (origin := self.cell.pose_of(self._frame)) != IDENTITY:
            back = rotation.inverted(origin)
            poses = [rotation.composed(back, pose) for pose in poses]
            centre = (rotation.homogeneous(back) @ [*centre, 1.0])[:3]
        return np.concatenate([np.array(poses).ravel(), centre])


def posed(row: Array) -> tuple[Point, Quaternion]:
    """A row x, y, z, w, x, y, z as a place and a turn."""
    x, y, z, w, qx, qy, qz = row.tolist()
    return (x, y, z), (w, qx, qy, qz)
