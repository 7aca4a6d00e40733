"""The paper's motion vector: six numbers a node, 540 for 90 nodes. It stands at the edge; nothing inside uses it.

A row is Xpos Ypos Zpos Zrot Xrot Yrot, cm and degrees. The paper mixes two conventions. A human's row is that of the
suit's BVH: the joint's place in its parent, then its own rotation, R = Rz Rx Ry. A row of an arm follows eq. (1): its
rotation is the one that its parent does before the row's translation (eqs. 6 to 9), so joint i stands in the row after
its node, and a sliding joint in the translation of that row. End sites of the human are zeros, since the suit
sends none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.contracts.rotation import EulerQuaternions, Order, euler_angles, matrices
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import SIDES, Side

COLUMNS: Final = ("Xpos", "Ypos", "Zpos", "Zrot", "Xrot", "Yrot")
_ORDER: Final[Order] = "ZXY"
_COLUMN: Final = {"z": 3, "x": 4, "y": 5}
_SLIDE: Final = {"x": 0, "y": 1, "z": 2}


class PaperVector:
    """Writes and reads motion vectors of one skeleton, as (nodes, 6): row after row they are the paper's vector."""

    def __init__(self, figure: HumanSrl) -> None:
        self._figure = figure
        self._joints = figure.joints
        self._euler = EulerQuaternions(_ORDER, len(figure.joints))
        self._rows, self._columns, self._factors = {}, {}, {}
        self._rest: Array = np.zeros((len(figure.tree), 6))
        for side in SIDES:
            first, axes = figure.arm[side].start, figure.arms.axes(side)
            self._rest[figure.arm[side], :3] = figure.arms.offsets(side) * 100.0
            joints = figure.arms.joints
            self._rows[side] = np.array([first + 2 + i for i in range(len(joints))])
            self._columns[side] = np.array([(_SLIDE if j.slides else _COLUMN)[j.axis[-1]] for j in joints])
            self._factors[side] = np.array(
                [axis.sum() * (100.0 if j.slides else 180.0 / np.pi) for j, axis in zip(joints, axes, strict=True)]
            )

    def write(self, rotation: Array, translation: Array, arms: Mapping[Side, Array], out: Array) -> None:
        """Fills a vector.

        Args:
            rotation: (k, 4) unit quaternions of the human's joints in their parents.
            translation: (k, 3) m, of the same.
            arms: (n,) rad or m, by side; one that isn't given is at zero.
            out: (nodes, 6), cm and degrees.
        """
        out[:] = self._rest
        out[self._joints, :3] = translation * 100.0
        out[self._joints, 3:] = np.rad2deg(euler_angles(matrices(rotation), _ORDER))
        for side, angles in arms.items():
            out[self._rows[side], self._columns[side]] += angles * self._factors[side]

    def read(self, vector: Array) -> tuple[Array, Array, dict[Side, Array]]:
        """Returns rotation (k, 4), translation (k, 3) m, and the joints (n,) of each arm, of a vector (nodes, 6)."""
        rotation = np.empty((len(self._joints), 4))
        self._euler.fill(np.deg2rad(vector[self._joints, 3:]), rotation)
        moved = vector - self._rest
        arms = {side: moved[self._rows[side], self._columns[side]] / self._factors[side] for side in SIDES}
        return rotation, vector[self._joints, :3] / 100.0, arms
