"""The cell's part `body`: a person with the 59 joints of a capture suit, moved by springs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from srl.drivers.noitom.skeleton import JOINTS, Kind, Skeleton, is_finger
from srl.runtime.contracts.files import ProfilePath
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.sim.parts.body.model import Segment, Sex, segments
from srl.sim.parts.body.motion import Motion, Recorded, Script, Scripted
from srl.sim.parts.body.whole_body_wearer import WholeBodyWearer
from srl.sim.wearer.people import subject
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_UPDATE: Final = 0.002  # s between two reference poses
_FINGERS: Final = 9.0  # times as stiff per inertia as other joints; otherwise arm swings would shake them
_TURN: Final = np.array([0.5, 0.5, 0.5, 0.5])  # turns the suit's x left, y up, z forward to y, z, x of the cell
_SKIN: Final = {"rgba": "0.85 0.68 0.58 1", "friction": (0.8, 0.005, 0.0001)}


class BodyConfig(PartConfig):
    """Options. `at` places the origin of the suit's world, on the floor, in the cell."""

    skeleton: Kind = Field(default="axis-neuron", description="the tree of joints")
    script: Script | Literal["actions"] = Field(
        default="still",
        description="motion, where nothing is recorded; 'walk' goes in a circle, 'actions' does the ten in turn, "
        "or what it is told",
    )
    subject: int = Field(default=0, ge=0, description="who does the actions: people differ; 0 is the average man")
    pause: float = Field(default=2.5, ge=0, le=60, description="s at ease before each of the ten actions")
    recording: ProfilePath | None = Field(
        default=None, description="BVH or MVNX file of the suit's software; its last pose is held"
    )
    loop: bool = Field(default=False, description="play the recording back and forth")
    scale: float = Field(default=1.0, gt=0.3, lt=3, description="of the default body, or of the recording's")
    mass: float = Field(default=75.0, gt=10, lt=300, description="kg")
    sex: Sex = Field(default="male", description="which of de Leva's sets gives the parts of the mass")
    fingers: bool = Field(default=False, description="they move; otherwise they stay as they are at the start")
    bandwidth: float = Field(default=8.0, ge=1, le=30, description="Hz, up to which joints follow the motion")
    damping: float = Field(default=1.0, ge=0.3, le=3, description="damping ratio of a joint by itself")
    contact: bool = Field(default=False, description="things can touch the person, and push")


class BodyPart(Part):
    """A free chain of bodies `<name>/<Joint>` on which other parts can be mounted.

    Each body has the suit's axes in the T-pose: x to the body's left, y up, z forward.

    The hips are welded softly to the motion's hips. Springs pull 20 ball joints (58 with `fingers`) towards the
    motion's angles. The stiffness of each follows from the bandwidth and the inertia behind it, mounted parts included.
    The body holds its own weight, not what it carries. So what a suit measures lags, gives way, and swings.

    Truth: `<name>_position` (59, 3), m, of the joints in the world.

    Attributes:
        skeleton: the tree.
        offsets: (59, 3), m, of the joints in their parents.
        duration: s of a recording; None without a recording.
        wearer: who does the actions, with that script.
    """

    Config = BodyConfig
    summary = "a person with the joints of a motion capture suit, by a script or as recorded"

    def __init__(self, name: str, config: BodyConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self.skeleton = Skeleton(config.skeleton)
        self._motion: Motion
        self.duration: float | None = None
        self.wearer: WholeBodyWearer | None = None
        if config.recording is not None:
            self._motion = recorded = Recorded(config.recording, self.skeleton, config.scale, config.loop)
            self.duration = recorded.duration
        elif config.script == "actions":
            who = subject(config.subject, self.skeleton.names)
            self._motion = self.wearer = WholeBodyWearer(who, self.skeleton, config.scale, config.pause)
        else:
            self._motion = Scripted(config.script, self.skeleton, config.scale, seed, name)
        self.offsets = self._motion.offsets
        self._moving = np.array(
            [i for i, n in enumerate(self.skeleton.names) if i and (config.fingers or not is_finger(n))]
        )
        self.every = 1
        self.truth = (
            Signal(
                name=f"{name}_position", shape=(JOINTS, 3), unit="m", labels=self.skeleton.names, components=(POINT,),
                visual="points", links=_polylines(self.skeleton.parents),
            ),
        )  # fmt: skip
        self._omega = 2.0 * np.pi * config.bandwidth
        # Springs and weld pull towards the future motion, so that their damping adds no delay.
        self._lead = 2.0 * config.damping / self._omega
        self._model: Any = None
        self._data: Any = None
        self._base = np.empty(4)
        self._local = np.zeros((JOINTS, 7))
        self._local[:, 3] = 1.0

    # -- the model

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        config, name, names = self._config, self.name, self.skeleton.names
        mujoco.mju_mulQuat(self._base, np.array(self.stand[3:]), _TURN)
        made = segments(self.skeleton, self.offsets, config.mass, config.sex, config.fingers)
        hips, rotations = self._motion.at(0.0)
        pos, quat = self._to_world(hips, rotations[0])
        elements: list[Element] = []
        for i, (joint, up) in enumerate(zip(names, self.skeleton.parents, strict=True)):
            full = f"{name}/{joint}"
            moves = i in self._moving
            if up < 0:
                body = mjcf.body(mjcf.worldbody, full, pos=pos, quat=quat, gravcomp=1)
                add(body, "freejoint", name=full)
            else:
                # A body without a joint keeps its start pose.
                turned = (1.0, 0.0, 0.0, 0.0) if moves else rotations[i]
                body = mjcf.body(elements[up], full, pos=self.offsets[i], quat=turned, gravcomp=1)
                if moves:  # stiffness and damping are set when the inertia is known
                    add(body, "joint", name=full, type="ball", stiffness=1.0, damping=1.0)
            elements.append(body)
            if i in made:
                self._segment(body, full, made[i])
        # Its delay is then that of the springs.
        mjcf.lead(name, f"{name}/Hips", self._lead / 2.0, pos=pos, quat=quat)

    def _segment(self, body: Element, full: str, segment: Segment) -> None:
        add(body, "inertial", pos=segment.com, mass=segment.mass, diaginertia=segment.inertia)
        size: dict[str, object] = {"pos": segment.centre, "size": segment.size}
        if segment.shape == "capsule":
            ends = [segment.centre + sign * segment.size[1] * segment.axis for sign in (-1.0, 1.0)]
            size = {"fromto": np.concatenate(ends), "size": segment.size[:1]}
        # Parts of the same body never touch each other: neighbours overlap at the joints.
        contact = CONTACT["hand" if self._config.contact else "none"]
        add(body, "geom", name=full, type=segment.shape, mass=0.0, **size, **contact, **_SKIN)

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self.every = max(1, round(_UPDATE / model.opt.timestep))
        names = [f"{self.name}/{joint}" for joint in self.skeleton.names]
        self._bodies = np.array([model.body(full).id for full in names])
        joints = np.array([model.joint(names[i]).id for i in self._moving])
        hips = model.joint(names[0])
        self._hips = slice(int(hips.qposadr[0]), int(hips.qposadr[0]) + 7)
        self._balls = model.jnt_qposadr[joints][:, None] + np.arange(4)
        self._mocap = int(model.body(f"{self.name}/target").mocapid[0])
        position, rotations = self._motion.at(0.0)
        data.qpos[self._hips] = np.concatenate(self._to_world(position, rotations[0]))
        data.qpos[self._balls] = rotations[self._moving]
        self._local[:, :3] = model.body_pos[self._bodies]
        self._local[:, 3:] = rotations
        dofs = model.jnt_dofadr[joints][:, None] + np.arange(3)
        stiffness = self._inertia()[dofs].max(axis=1) * self._omega**2
        stiffness[[is_finger(self.skeleton.names[i]) for i in self._moving]] *= _FINGERS
        model.jnt_stiffness[joints] = stiffness
        model.dof_damping[dofs] = (stiffness * self._lead)[:, None]
        self.drive(0)

    def _inertia(self) -> Array:
        """(nv,): inertia that each degree of freedom moves, in the model's reference pose (here the T-pose)."""
        data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, data)
        unit, moved = np.eye(self._model.nv), np.empty(self._model.nv)
        inertia = np.empty(self._model.nv)
        for i, row in enumerate(unit):  # the format of the matrix itself differs between versions
            mujoco.mj_mulM(self._model, data, moved, row)
            inertia[i] = moved[i]
        return inertia

    # -- life cycle

    def drive(self, step: int) -> None:
        """Gives springs and weld the motion a little ahead of time."""
        position, rotations = self._motion.at((step + 0.5 * self.every) * self._model.opt.timestep + self._lead)
        self._model.qpos_spring[self._balls] = rotations[self._moving]
        self._data.mocap_pos[self._mocap], self._data.mocap_quat[self._mocap] = self._to_world(position, rotations[0])

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_position"][...] = self._data.xpos[self._bodies]

    def save(self) -> Array:
        springs: Array = self._model.qpos_spring[self._balls].ravel()
        return springs if self.wearer is None else np.concatenate([springs, self.wearer.save()])

    def restore(self, state: Array) -> None:
        springs = 4 * len(self._moving)
        self._model.qpos_spring[self._balls] = state[:springs].reshape(-1, 4)
        if self.wearer is not None:
            self.wearer.restore(state[springs:])

    # -- what a suit measures

    def pose(self) -> Array:
        """(59, 7): true x, y, z (m), w, x, y, z of every joint in its parent; a view, which the next call changes.

        The pose of the hips is in the suit's world: y up, z forward, x to the left.
        """
        local, data = self._local, self._data
        hips = data.qpos[self._hips]
        back = self._base * [1.0, -1.0, -1.0, -1.0]
        mujoco.mju_rotVecQuat(local[0, :3], hips[:3] - self.stand[:3], back)
        mujoco.mju_mulQuat(local[0, 3:], back, hips[3:])
        local[self._moving, 3:] = data.qpos[self._balls]
        return local

    def wanted(self, t: float) -> tuple[Array, Array]:
        """The motion at t seconds: hips (3,), m, in the suit's world, and quaternions (59, 4)."""
        return self._motion.at(t)

    def _to_world(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Converts from the suit's world to the cell."""
        pos, quat = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(pos, position, self._base)
        mujoco.mju_mulQuat(quat, self._base, rotation)
        return pos + self.stand[:3], quat


def _polylines(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Paths that cover every bone once, each from a tip up to a joint that is already drawn."""
    drawn, lines = {0}, []
    for tip in sorted(set(range(len(parents))) - set(parents)):
        line = [tip]
        while line[-1] not in drawn:
            drawn.add(line[-1])
            line.append(parents[line[-1]])
        lines.append(tuple(line))
    return tuple(lines)
