"""The cell's part `mocap-body`: a rigid body with markers that follows a motion, as physics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.sim.parts.body.mocap_motion import MotionConfig, make_motion
from srl.sim.parts.body.subject import MocapSubject, SeenSegment
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, PartConfig

_UPDATE: Final = 0.002  # s between two targets
_MARKERS: Final = {  # all distances differ, so that the body can be told from its mirror image
    "M1": (0.0, 0.0, 0.05),
    "M2": (0.06, 0.0, 0.0),
    "M3": (0.0, 0.045, 0.0),
    "M4": (-0.035, -0.02, 0.0),
}
Vector = tuple[float, float, float]


class MocapBodyConfig(PartConfig):
    """Options; `position` and `quaternion` set where the motion starts."""

    motion: MotionConfig = MotionConfig()
    subject: str | None = Field(default=None, description="its name in the capture system; None: the part's name")
    segment: str | None = Field(default=None, description="its segment's name there; None: the subject's")
    markers: dict[str, Vector] = Field(default=_MARKERS, description="m, in the body's frame, by name")
    size: Vector = Field(default=(0.03, 0.03, 0.01), description="m, half lengths of its box")
    mass: float = Field(default=0.2, gt=0, description="kg")
    stiffness: float = Field(default=0.02, gt=0.002, le=1.0, description="s, in which it returns to its motion")
    contact: bool = Field(default=True, description="other things can touch it, hold it back and be pushed")


class MocapBody(MocapSubject):
    """A free, weightless body, welded softly to a target that follows the motion exactly.

    So it lags, and gives way to obstacles in its path; the cameras see its true position.

    Truth: `<name>_pose` (7,): x, y, z (m), w, x, y, z; `<name>_markers` (k, 3), m.
    """

    Config = MocapBodyConfig
    summary = "a body with markers that moves by a script or as recorded, for motion capture"

    def __init__(self, name: str, config: MocapBodyConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self._motion = make_motion(config.motion)
        self.subject = config.subject or name
        segment = config.segment or self.subject
        self.segments = {segment: SeenSegment(f"{name}/body")}
        self.markers = dict.fromkeys(config.markers, segment)
        self._labels = tuple(config.markers)
        self.every = 1
        truth = [Signal(name=f"{name}_pose", shape=(7,), unit="m", labels=POSE)]
        if self._labels:
            shape = (len(self._labels), 3)
            truth.append(
                Signal(
                    name=f"{name}_markers",
                    shape=shape,
                    unit="m",
                    labels=self._labels,
                    components=(POINT,),
                    visual="points",
                )
            )
        self.truth = tuple(truth)
        self._data: Any = None
        self._dt = 0.0
        self._body = self._mocap = 0
        self._sites = np.empty(0, np.intp)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        config, name = self._config, self.name
        self._base = np.array(self.stand[3:])
        body = mjcf.body(mjcf.worldbody, f"{name}/body", gravcomp=1, **self.at())
        add(body, "freejoint", name=f"{name}/free")
        contact = CONTACT["object" if config.contact else "none"]
        add(body, "geom", name=f"{name}/box", type="box", size=config.size, mass=config.mass, **contact)
        for label, place in config.markers.items():
            add(body, "site", name=f"{name}/{label}", pos=place, size=(0.007,), rgba="0.8 0.8 0.8 1")
        mjcf.lead(name, f"{name}/body", config.stiffness, **self.at())

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._dt = data, model.opt.timestep
        self._body = model.body(f"{self.name}/body").id
        self._mocap = model.body(f"{self.name}/target").mocapid[0]
        self._sites = np.array([model.site(f"{self.name}/{label}").id for label in self._labels], np.intp)
        self.every = max(1, round(_UPDATE / self._dt))
        at = model.joint(f"{self.name}/free").qposadr[0]
        data.qpos[at : at + 7] = self.target(0.0)
        self.drive(0)

    def target(self, t: float) -> Array:
        """(7,): the target pose of the motion at t seconds, in the world."""
        pose = self._motion.at(t)
        mujoco.mju_rotVecQuat(pose[:3], pose[:3].copy(), self._base)
        mujoco.mju_mulQuat(pose[3:], self._base, pose[3:].copy())
        pose[:3] += self.stand[:3]
        return pose

    def drive(self, step: int) -> None:
        pose = self.target((step + self.every) * self._dt)
        self._data.mocap_pos[self._mocap] = pose[:3]
        self._data.mocap_quat[self._mocap] = pose[3:]

    def fill(self, truth: Mapping[str, Array]) -> None:
        out = truth[f"{self.name}_pose"]
        out[:3], out[3:] = self._data.xpos[self._body], self._data.xquat[self._body]
        if self._labels:
            truth[f"{self.name}_markers"][...] = self.marker_positions()

    def marker_positions(self) -> Array:
        """(k, 3), m: positions of the markers."""
        positions: Array = self._data.site_xpos[self._sites]
        return positions
