"""The cell's part `upper-body`: a wearer's trunk and arms, moved as the wearer means to, with markers on the skin."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Any, Final, cast
from xml.etree.ElementTree import Element

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.contracts.wearer import Dof
from srl.sim.parts.body.arm_posture import ArmPosture
from srl.sim.parts.body.subject import MocapSubject, SeenSegment
from srl.sim.parts.body.wearer import NAMES, BodyWearer, workspace
from srl.sim.parts.body.wearer_config import UpperBodyConfig
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, PartConfig

_TICK: Final = 0.005  # s between two postures
_ARMATURE: Final = 10.0  # kg m^2 (kg for what slides): so heavy that what is worn and carried doesn't move the arm
_MASS: Final = 0.05  # kg of a segment; next to the armature it doesn't matter
_SKIN: Final = {"rgba": "0.85 0.68 0.58 1", "friction": (0.8, 0.005, 0.0001)}
_SHAPES: Final = {"upper_arm": 0.040, "forearm": 0.032, "hand": 0.020}  # m, radius


_Watched = tuple[int, int, float, float]


class UpperBodyPart(MocapSubject):
    """A body whose joints move as the wearer means; contacts don't move them. What stands on its segments feels it.

    Bodies are `<name>/torso`, `<name>/right_clavicle`, `<name>/right_upper_arm`, `<name>/right_forearm`,
    `<name>/right_hand` (and the left ones), with the axes and origins of `srl.runtime.models.body`.

    Truth: `<name>_position` (n,) rad, of the joints that turn; `<name>_hand` (7,) m and w x y z, the palm's middle in
    the chest's frame; `<name>_markers` (k, 3) m, in the world; `<name>_dofs` (3,) rad, the swivel angle and the
    clavicle's elevation and protraction; `<name>_leak` (1,) m, how far the hand is from where it is meant to be.

    Attributes:
        body: its description.
        wearer: who moves it (`srl.runtime.contracts.wearer.Wearer`), once the world is made.
    """

    Config = UpperBodyConfig
    summary = "a wearer's trunk and arms with markers, who moves them while the hand is still"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(UpperBodyConfig, config)
        self.body = body = config.model.body
        self._arm = ArmPosture(body, config.side)
        self.every = 1
        self._q = np.zeros(len(body.joints))
        for side in body.sides:
            if side != config.side:  # it rests
                other = ArmPosture(body, side)
                rest = other.natural(workspace(other)[2], config.elbow)
                self._q[other.joints] = other.solve(rest, config.elbow)
        self._torso = [body.names.index(f"torso_{turn}") for turn in ("yaw", "lean", "side")]
        self._turns = np.array([i for i, joint in enumerate(body.joints) if not joint.slides])
        self.subject = config.subject or name
        self.segments = {
            segment: SeenSegment(f"{name}/{segment}", _parent(segment, body.segments)) for segment in body.segments
        }
        self.markers = {label: marker.segment for label, marker in body.markers.items()}
        self._slips = {label: (np.array(slip.by), slip.at) for label, slip in config.slip.items()}
        labels = tuple(body.markers)
        self.truth = (
            Signal(
                name=f"{name}_position", shape=(len(self._turns),), unit="rad",
                labels=tuple(body.names[i] for i in self._turns),
            ),
            Signal(name=f"{name}_hand", shape=(7,), unit="m", labels=POSE),
            Signal(
                name=f"{name}_markers", shape=(len(labels), 3), unit="m", labels=labels, components=(POINT,),
                visual="points",
            ),
            Signal(name=f"{name}_dofs", shape=(3,), unit="rad", labels=NAMES),
            Signal(name=f"{name}_leak", shape=(1,), unit="m"),
        )  # fmt: skip

    # -- the model

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        body, name = self.body, self.name
        elements: dict[str, Element] = {}
        joint = 0
        for segment, last in sorted(body.segments.items(), key=lambda item: item[1]):
            up = _parent(segment, body.segments)
            if up:
                made = mjcf.body(elements[up], f"{name}/{segment}", pos=body.joints[joint].place, gravcomp=1)
            else:
                made = mjcf.body(parent, f"{name}/{segment}", gravcomp=1, **self.at())
            elements[segment] = made
            add(made, "inertial", pos="0 0 0", mass=_MASS, diaginertia=(1e-4, 1e-4, 1e-4))
            for one in body.joints[joint : last + 1]:
                kind = "slide" if one.slides else "hinge"
                add(made, "joint", name=f"{name}/{one.name}", type=kind, axis=one.axis, armature=_ARMATURE)
            joint = last + 1
            self._flesh(made, segment)
        for label, marker in body.markers.items():
            add(
                elements[marker.segment], "site", name=f"{name}/{label}", pos=marker.at, size=(0.007,),
                rgba="0.8 0.8 0.8 1",
            )  # fmt: skip

    def _flesh(self, element: Element, segment: str) -> None:
        """What is seen of a segment, and what can be touched of forearm and hand."""
        side, _, part = segment.partition("_")
        if part not in _SHAPES:
            if segment == "torso":
                shape = {"type": "capsule", "fromto": (-0.08, 0.0, -0.12, -0.08, 0.0, -0.42), "size": 0.12}
                add(element, "geom", name=f"{self.name}/{segment}", mass=0.0, **shape, **CONTACT["none"], **_SKIN)
            return
        length = self.body.sizes[part][cast(Any, side)]
        touched = self._config.contact and part != "upper_arm" and side == self._config.side
        shape = {"type": "capsule", "fromto": (0.0, 0.0, 0.0, 0.0, 0.0, -length), "size": _SHAPES[part]}
        contact = CONTACT["hand" if touched else "none"]
        add(element, "geom", name=f"{self.name}/{segment}", mass=0.0, **shape, **contact, **_SKIN)

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        name, body, timestep = self.name, self.body, float(model.opt.timestep)
        self.every = max(1, round(_TICK / timestep))
        self._dt = self.every * timestep
        self.wearer = BodyWearer(self._config, self._arm, self.seed, name, self._dt)
        joints = [model.joint(f"{name}/{joint}") for joint in body.names]
        self._qpos = np.array([int(joint.qposadr[0]) for joint in joints])
        self._qvel = np.array([int(joint.dofadr[0]) for joint in joints])
        self._markers = np.array([model.site(f"{name}/{label}").id for label in body.markers], np.intp)
        self._chest = int(model.body(f"{name}/torso").id)
        self._hand = int(model.body(f"{name}/{self._config.side}_hand").id)
        self._grip: rotation.Pose = (*body.grip(self._config.side), 1.0, 0.0, 0.0, 0.0)
        self._watched = [self._watch(dof, model) for dof in self._config.watches]
        # What is wanted at the last, this and the next tick, so that the motion between is smooth.
        self._ahead = np.tile(self._wanted(), (4, 1))
        self._timestep = timestep
        data.qpos[self._qpos] = self._ahead[0, : len(self._q)]
        self._slip(0.0)

    def _watch(self, dof: Dof, model: Any) -> _Watched:
        """The DoF's number; the address, the open and the closed position of the joint that it drives."""
        watched = self._config.watches[dof]
        names = [model.joint(i).name for i in range(model.njnt)]
        if watched.joint not in names:
            place = f"sim.parts.{self.name}.watches.{dof}.joint"
            raise WiringError(place, f"the cell has no joint '{watched.joint}'", nearest(watched.joint, names))
        return NAMES.index(dof), int(model.joint(watched.joint).qposadr[0]), watched.open, watched.closed

    def _wanted(self) -> Array:
        """(n + 6,): all joints as the wearer has them; where the hand is meant to be, m; the DoFs, rad."""
        q = self._q.copy()
        q[self._arm.joints] = self.wearer.q
        q[self._torso] = self.wearer.torso
        return np.concatenate([q, self.wearer.place, self.wearer.dofs])

    # -- life cycle

    def drive(self, step: int) -> None:
        """Puts the joints where they belong, with the velocity and the acceleration that take them to the next tick."""
        number, T = step // self.every, self._dt
        for dof, at, opened, closed in self._watched:
            self.wearer.watch(dof, (float(self._data.qpos[at]) - opened) / (closed - opened))
        self.wearer.next(number + 2)
        self._ahead[:3] = self._ahead[1:]
        self._ahead[3] = self._wanted()
        before, now, after, beyond = self._ahead[:, : len(self._q)]
        speed = (after - before) / (2.0 * T)
        acceleration = ((beyond - now) / (2.0 * T) - speed) / T
        data = self._data
        data.qpos[self._qpos] = now
        # Half a step's share less, as the integrator changes the velocity before it moves.
        data.qvel[self._qvel] = speed - 0.5 * self._timestep * acceleration
        data.qfrc_applied[self._qvel] = _ARMATURE * acceleration
        self._slip(step * self._timestep)

    def _slip(self, t: float) -> None:
        for label, (by, at) in self._slips.items():
            site = self._model.site(f"{self.name}/{label}").id
            self._model.site_pos[site] = np.array(self.body.markers[label].at) + (by if t >= at else 0.0)

    def fill(self, truth: Mapping[str, Array]) -> None:
        name, data = self.name, self._data
        truth[f"{name}_position"][:] = data.qpos[self._qpos[self._turns]]
        chest, hand = (
            as_pose(np.array([*data.xpos[body].tolist(), *data.xquat[body].tolist()]))
            for body in (self._chest, self._hand)
        )
        pose = rotation.composed(rotation.inverted(chest), rotation.composed(hand, self._grip))
        truth[f"{name}_hand"][:] = pose
        truth[f"{name}_markers"][...] = data.site_xpos[self._markers]
        meant, dofs = self._ahead[1, -6:-3], self._ahead[1, -3:]
        truth[f"{name}_dofs"][:] = dofs
        leak = pose[:3] - meant
        truth[f"{name}_leak"][0] = sqrt(leak @ leak)

    def save(self) -> Array:
        return np.concatenate([self._ahead.ravel(), self.wearer.save()])

    def restore(self, state: Array) -> None:
        count = self._ahead.size
        self._ahead = state[:count].reshape(4, -1).copy()
        self.wearer.restore(state[count:])
        self._slip(float(self._data.time))


def _parent(segment: str, segments: Mapping[str, int]) -> str:
    """The segment on which one hangs; "" for the trunk."""
    chain = ("clavicle", "upper_arm", "forearm", "hand")
    side, _, part = segment.partition("_")
    if part not in chain:
        return ""
    at = chain.index(part)
    return f"{side}_{chain[at - 1]}" if at else "torso"
