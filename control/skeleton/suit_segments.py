"""The law `suit-segments`: poses of segments from the joints of a capture suit, for laws that take segments."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from srl.control.skeleton.human import human
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.rotation import Pose, composed
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT, POSE, QUATERNION
from srl.runtime.contracts.transforms import Transform
from srl.runtime.contracts.transforms import frame as place


class SuitSegmentsConfig(ControllerConfig):
    """Options of `suit-segments`."""

    joints: dict[str, str] = Field(min_length=1, description="NAME: the suit's joint, such as chest: Spine3")
    suit: str = Field(
        "suit", description="frame of the profile's tree that is the suit's world: x left, y up, z forward"
    )
    frame: str = Field(description="frame of the profile's tree in which the poses are given, such as a room with z up")

    @model_validator(mode="after")
    def _known(self) -> SuitSegmentsConfig:
        tree = human()
        names = [tree.names[i] for i in tree.joints]
        for name, joint in self.joints.items():
            if joint not in names:
                raise OptionError(f"joints.{name}: a suit has no joint '{joint}'", nearest(joint, names))
        return self


class SuitSegments(Controller):
    """Plain forward kinematics of the joints that the chosen ones hang on.

    Inputs: `rotation` (59, 4) w x y z, `translation` (59, 3) m, of a suit's joints in their parents. Outputs: `pose`
    (k, 7) m and w x y z of the chosen joints in the option's frame; `visible` (k,): 1, or 0 where the suit has no pose.
    """

    Config = SuitSegmentsConfig
    summary = "poses of segments from a suit's joints"

    def __init__(self, name: str, config: SuitSegmentsConfig) -> None:
        super().__init__(name, config)
        tree = human()
        labels = tuple(tree.names[i] for i in tree.joints)
        rows = {node: row for row, node in enumerate(tree.joints)}
        parents = [rows.get(tree.parents[node], -1) for node in tree.joints]
        self.inputs = (
            Signal(name="rotation", shape=(len(labels), 4), unit="1", labels=labels, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(labels), 3), unit="m", labels=labels, components=(POINT,)),
        )
        names = tuple(config.joints)
        self.outputs = (
            Signal(name="pose", shape=(len(names), 7), unit="m", frame=config.frame, labels=names, components=(POSE,)),
            Signal(name="visible", shape=(len(names),), unit="1", labels=names),
        )
        need = f"the suit's world in '{config.frame}'"
        self.transforms = (Transform("world", place(config.suit), place(config.frame), need),)
        self._wanted = [labels.index(joint) for joint in config.joints.values()]
        needed = set[int]()
        for row in self._wanted:
            above = row
            while above >= 0:
                needed.add(above)
                above = parents[above]
        self._chain = [(row, parents[row]) for row in sorted(needed)]

    def reset(self) -> None:
        self.update(0.0)

    def update(self, dt: float) -> None:
        local = np.hstack([self.input["translation"], self.input["rotation"]])
        size = np.abs(np.linalg.norm(local[:, 3:], axis=1) - 1.0)
        rows = [row for row, _ in self._chain]
        there = bool(np.isfinite(local[rows]).all() and (size[rows] < 1e-3).all())
        self.output["visible"][:] = float(there)
        if not there:
            return
        within: dict[int, Pose] = {-1: as_pose(self.transform["world"])}
        for row, parent in self._chain:
            x, y, z, w, qx, qy, qz = local[row].tolist()
            pose = (x, y, z, w, qx, qy, qz)
            within[row] = composed(within[parent], pose)
        self.output["pose"][:] = [within[row] for row in self._wanted]
