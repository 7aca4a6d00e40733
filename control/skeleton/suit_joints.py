"""The law `suit-joints`: the joints of a capture suit from segments that any system measures in the room.

Vicon, OptiTrack and Xsens give poses of segments in a world; laws of a whole body take the 59 joints of a suit, each in
its parent. So those laws serve every system.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from srl.control.skeleton.human import human
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.frames import Placement, as_pose
from srl.runtime.contracts.rotation import Pose, Quaternion, composed, inverted
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE, QUATERNION
from srl.runtime.contracts.transforms import Transform, coordinates, frame

_REST: Final[Quaternion] = (1.0, 0.0, 0.0, 0.0)
_UNIT: Final = 1e-3  # by which a quaternion's length may differ from 1


class SuitJointsConfig(ControllerConfig):
    """Options of `suit-joints`."""

    segments: dict[str, str] = Field(
        min_length=1, description="NAME: JOINT, the device's segments and the suit's joints; Hips must be there"
    )
    axes: Placement = Field(
        default_factory=Placement,
        description="the suit's axes (x left, y up, z forward in the T-pose) in every segment",
    )
    frame: str = Field("suit", description="frame of the profile's tree with x left, y up, z forward: the suit's world")
    scale: float = Field(1.0, gt=0.3, lt=3, description="of the standard body, for joints that nothing measures")
    max_hold: float = Field(
        0.25,
        gt=0,
        le=10,
        description="s for which a hidden segment stays in its parent as it was; then the person is lost",
    )

    @model_validator(mode="after")
    def _known(self) -> SuitJointsConfig:
        tree = human()
        names = [tree.names[i] for i in tree.joints]
        joints = list(self.segments.values())
        for name, joint in self.segments.items():
            if joint not in names:
                raise OptionError(f"segments.{name}: a suit has no joint '{joint}'", nearest(joint, names))
        if twice := [joint for joint in joints if joints.count(joint) > 1]:
            raise OptionError(f"segments: two of them are '{twice[0]}'", "Give each joint one segment")
        if "Hips" not in joints:
            raise OptionError("segments: nothing is Hips", "Name the segment that moves with the pelvis")
        return self


class SuitJoints(Controller):
    """Each joint's place and turn in its parent, from its own segment's pose and that of the next measured one above.

    Inputs: `pose` (k, 7) m and w x y z of segments; `visible` (k,). Outputs: `rotation` (59, 4) w x y z and
    `translation` (59, 3) m, as a suit gives them: of each joint in its parent, of the hips in the suit's world. A joint
    that nothing measures doesn't turn, and has the standard body's place.

    What is hidden keeps its turn and place in its parent, so its row repeats itself; after `max_hold` that is a loss.
    NaN until all segments were seen once after a reset.
    """

    Config = SuitJointsConfig
    summary = "a suit's 59 joints from segments that any capture system measures"

    def __init__(self, name: str, config: SuitJointsConfig) -> None:
        super().__init__(name, config)
        tree = human(config.scale)
        labels = tuple(tree.names[i] for i in tree.joints)
        rows = {node: row for row, node in enumerate(tree.joints)}
        self._parents = tuple(rows.get(tree.parents[node], -1) for node in tree.joints)
        segments = tuple(config.segments)
        self.inputs = (
            Signal(name="pose", shape=(len(segments), 7), unit="m", labels=segments, components=(POSE,)),
            Signal(name="visible", shape=(len(segments),), unit="1", labels=segments),
        )
        self.outputs = (
            Signal(name="rotation", shape=(len(labels), 4), unit="1", labels=labels, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(labels), 3), unit="m", labels=labels, components=(POINT,)),
        )
        need = f"the world of the segments in '{config.frame}', the suit's"
        self.transforms = (Transform("frame", coordinates("pose"), frame(config.frame), need),)
        self._axes: Pose = config.axes.placed()
        measured = {labels.index(joint): i for i, joint in enumerate(config.segments.values())}
        above = {row for joint in measured for row in self._above(joint)}
        self._order = [(row, measured.get(row)) for row in sorted(above)]  # a parent comes before its children
        self._rest = tree.offsets[list(tree.joints)]
        self._local: list[Pose] = []
        self._hold = config.max_hold
        self._hidden: Array = np.zeros(len(segments))  # s
        self._losses = 0
        self._forget()

    def _above(self, row: int) -> list[int]:
        found = [row]
        while self._parents[found[-1]] >= 0:
            found.append(self._parents[found[-1]])
        return found

    def _forget(self) -> None:
        """All joints at rest, none seen."""
        self._local = [(x, y, z, *_REST) for x, y, z in self._rest.tolist()]
        self._seen = np.zeros(len(self._hidden), np.bool_)

    def reset(self) -> None:
        self._forget()
        self._hidden[:] = 0.0
        self.lost = False
        self.output["rotation"][:] = np.nan
        self.output["translation"][:] = np.nan
        self._compute()

    def update(self, dt: float) -> None:
        visible = self._compute()
        self._hidden = np.where(visible, 0.0, self._hidden + dt)
        lost = bool((self._hidden > self._hold).any())
        self._losses += lost and not self.lost
        self.lost = lost

    def metrics(self) -> dict[str, object]:
        """How often a segment was hidden for too long."""
        return {"losses": self._losses}

    def _compute(self) -> NDArray[np.bool_]:
        """Fills the outputs; returns which segments are there."""
        poses, world = self.input["pose"], as_pose(self.transform["frame"])
        size = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0)
        visible: NDArray[np.bool_] = (self.input["visible"] > 0.0) & (size < _UNIT) & np.isfinite(poses).all(axis=1)
        self._seen |= visible
        within: dict[int, Pose] = {-1: (0.0, 0.0, 0.0, *_REST)}  # in the suit's world
        for row, segment in self._order:
            parent = within[self._parents[row]]
            if segment is not None and visible[segment]:
                pose = composed(world, composed(as_pose(poses[segment]), self._axes))
                self._local[row] = composed(inverted(parent), pose)
            else:
                pose = composed(parent, self._local[row])
            within[row] = pose
        if self._seen.all():
            local = np.array(self._local)
            self.output["translation"][:], self.output["rotation"][:] = local[:, :3], local[:, 3:]
        return visible
