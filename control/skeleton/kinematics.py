"""Positions of all nodes by MuJoCo: one model for kinematics and, with shapes added to it, for distances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import SIDES, Side


class Kinematics:
    """Forward kinematics of human and arms.

    Each node is a body with the node's name; body i + 1 is node i. The human's joints are balls at places that are
    written in each frame, since a suit's bones stretch. An arm's sliding joint moves the next node.

    Attributes:
        figure: the skeleton.
        model, data: MuJoCo's; `data.xpos[1:]`, `data.xmat[1:]` are the nodes after `nodes`.
    """

    def __init__(self, figure: HumanSrl, shape: Callable[[Any], None] | None = None) -> None:
        """
        Args:
            figure: the skeleton.
            shape: adds what else the model shall hold, such as capsules: takes the `mujoco.MjSpec` before compiling.
                It must not add bodies or joints.
        """
        self.figure = figure
        spec = _spec(figure)
        if shape is not None:
            shape(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        tree = figure.tree
        if tuple(self.model.body(i + 1).name for i in range(len(tree))) != tree.names:
            raise ValueError("the bodies' order isn't the nodes'")
        names = figure.labels
        self._bodies = figure.joints + 1
        self._balls = self.model.jnt_qposadr[[self.model.joint(name).id for name in names]]
        # The arms' angles lie among the human's quaternions: the joints before them, and those after.
        before = int(np.searchsorted(figure.joints, figure.arm[SIDES[0]].start))
        self._runs = [
            (slice(a, b), slice(int(self._balls[a]), int(self._balls[a]) + 4 * (b - a)))
            for a, b in ((0, before), (before, len(names)))
            if b > a
        ]
        self._angles: dict[Side, slice] = {}
        for side in figure.arm:
            at = self.model.jnt_qposadr[[self.model.joint(f"{side}/{label}").id for label in figure.arms.labels]]
            assert (np.diff(at) == 1).all()
            self._angles[side] = slice(int(at[0]), int(at[-1]) + 1)
        self._nodes: Array = self.data.xpos[1:]
        self._places: Array = self.model.body_pos
        self._q: Array = self.data.qpos

    def body(self, name: str) -> int:
        """MuJoCo's id of a node's body. Raises KeyError."""
        return self.figure.tree.index(name) + 1

    def base(self, side: Side, quaternion: Array) -> None:
        """Turns an arm's base (and the arm with it) in its parent's frame, by a unit quaternion (4,), from now on."""
        self.model.body_quat[self.figure.arm[side].start + 1] = quaternion

    def nodes(self, rotation: Array, translation: Array, arms: Mapping[Side, Array]) -> Array:
        """The nodes' positions.

        Args:
            rotation: (k, 4) unit quaternions of the human's joints in their parents.
            translation: (k, 3) m, of the same.
            arms: (n,) rad or m, by side. A side that isn't given keeps its angles.

        Returns:
            (nodes, 3) m, in the suit's world; a view that the next call changes.
        """
        q = self._q
        self._places[self._bodies] = translation
        for human, place in self._runs:
            q[place] = rotation[human].ravel()
        for side, angles in arms.items():
            q[self._angles[side]] = angles
        mujoco.mj_kinematics(self.model, self.data)
        return self._nodes

    def rest(self) -> Array:
        """(nodes, 3) m: the T-pose, arms at zero; a view as `nodes`."""
        human = self.figure.human
        joints = list(human.joints)
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
        return self.nodes(still, human.offsets[joints], {side: np.zeros(self.figure.arms.n) for side in SIDES})


def _spec(figure: HumanSrl) -> Any:
    spec = mujoco.MjSpec()
    tree, balls = figure.tree, set(figure.joints.tolist())
    bodies: list[Any] = []
    for i, (node, up) in enumerate(zip(tree.nodes, tree.parents, strict=True)):
        above = spec.worldbody if up < 0 else bodies[up]
        # Nothing has weight: this model is never stepped. MuJoCo wants some on what moves.
        body = above.add_body(name=node.name, pos=node.offset, mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
        if i in balls:
            body.add_joint(name=node.name, type=mujoco.mjtJoint.mjJNT_BALL)
        bodies.append(body)
    for side, nodes in figure.arm.items():
        axes = figure.arms.axes(side)
        for k, (joint, label) in enumerate(zip(figure.arms.joints, figure.arms.labels, strict=True)):
            kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.slides else mujoco.mjtJoint.mjJNT_HINGE
            moved = bodies[nodes.start + 1 + k + joint.slides]
            moved.add_joint(name=f"{side}/{label}", type=kind, axis=axes[k])
    return spec
