"""The control law `skeleton`: the human-SRL skeleton's nodes from suit and servos, in each cycle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import Field

from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.options import SkeletonConfig
from srl.control.skeleton.paper import COLUMNS, PaperVector
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE, QUATERNION
from srl.runtime.models.skeleton import bvh

_UNIT: Final = 1e-3  # by which a quaternion's length may differ from 1


class SkeletonLawConfig(SkeletonConfig):
    """Options of `skeleton`."""

    frame: str | None = Field(None, description="frame of the profile's tree that the suit's world is")
    mount: str | None = Field(None, description="frame of the profile's tree that the output `mount` measures")
    vector: bool = Field(True, description="give the paper's motion vector, too; it takes longer than the nodes")


class Skeleton(Controller):
    """The nodes of human and supernumerary arms, and the paper's motion vector.

    Inputs: `rotation` (59, 4) and `translation` (59, 3) m of the suit's joints in their parents; `right`, `left` (n,)
    rad (m where a joint slides), the positions of the arms that exist. The nodes of one that
    doesn't are as at zero, and no picture links them.

    Outputs: `nodes` (90, 3) m in the suit's world (y up, z forward at calibration, x to the body's left); `vector`
    (90, 6), row after row the paper's 540 numbers, cm and degrees (`srl.control.skeleton.paper`); with the option
    `mount` also `mount` (7,), the pose in the suit's world of the body's node on which the arms hang, m.

    Source: Zhang, Liu, Li 2022, algorithm 1 without its drawing; forward kinematics as BVH means it.
    """

    Config = SkeletonLawConfig
    summary = "90 nodes of a wearer and supernumerary arms from a suit and servos"
    exports = ("bvh",)

    def __init__(self, name: str, config: SkeletonLawConfig) -> None:
        super().__init__(name, config)
        figure = config.figure
        tree, arms, joints = figure.tree, figure.arms, figure.labels
        self._kinematics = Kinematics(figure)
        self._kinematics.rest()
        self._paper = PaperVector(figure) if config.vector else None
        k, n = len(joints), len(tree)
        self.inputs = (
            Signal(name="rotation", shape=(k, 4), unit="1", labels=joints, components=(QUATERNION,)),
            Signal(name="translation", shape=(k, 3), unit="m", labels=joints, components=(POINT,)),
            *(
                Signal(name=side, shape=(arms.n,), unit="rad", labels=arms.labels, slides=arms.slides)
                for side in arms.sides
            ),
        )
        self.outputs = (
            Signal(
                name="nodes",
                shape=(n, 3),
                unit="m",
                frame=config.frame,
                labels=tree.names,
                components=(POINT,),
                visual="skeleton",
                links=figure.lines,
                groups=figure.groups,
            ),
        )
        if config.vector:
            self.outputs += (Signal(name="vector", shape=(n, 6), unit="1", labels=tree.names, components=(COLUMNS,)),)
        if config.mount is not None:
            self.outputs += (
                Signal(name="mount", shape=(7,), unit="m", frame=config.frame, of=config.mount, labels=POSE),
            )
        self._mount = self._kinematics.body(arms.parent) if config.mount is not None else None
        self._figure, self._sides = figure, arms.sides

    def reset(self) -> None:
        self.update(0.0)

    def update(self, dt: float) -> None:
        rotation, translation = self.input["rotation"], self.input["translation"]
        arms = {side: self.input[side] for side in self._sides}
        self.output["nodes"][:] = self._kinematics.nodes(rotation, translation, arms)
        if self._mount is not None:
            data, out = self._kinematics.data, self.output["mount"]
            out[:3], out[3:] = data.xpos[self._mount], data.xquat[self._mount]
        if self._paper is not None:
            self._paper.write(rotation, translation, arms, self.output["vector"])

    def export(self, form: str, inputs: Mapping[str, Array], period: float, path: Path) -> int:
        """Writes human and arms as BVH, in the suit's world. What comes before the suit's first frame is left out.

        A frame whose quaternions aren't of length 1 is no pose: the one before it is held.
        """
        rotation, translation = inputs["rotation"], inputs["translation"]
        size = np.abs(np.linalg.norm(rotation, axis=2) - 1.0).max(axis=1)
        good = (size < _UNIT) & np.isfinite(translation).all(axis=(1, 2))  # NaN isn't less than anything
        for side in self._sides:
            good &= np.isfinite(inputs[side]).all(axis=1)
        if not good.any():
            raise RecordingError(str(path), "the suit gave no pose in this recording", "Export another recording")
        newest = np.maximum.accumulate(np.where(good, np.arange(len(good)), -1))
        kept = newest[newest >= 0]
        arms = {side: inputs[side][kept] for side in self._sides}
        figure = self._figure
        bvh.write(path, figure.tree, *figure.whole(rotation[kept], translation[kept], arms), period)
        return len(kept)
