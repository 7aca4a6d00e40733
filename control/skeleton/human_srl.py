"""The human-SRL skeleton: a human's tree with both arms' nodes inserted behind the node on which they hang."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import SIDES, Arms, Side
from srl.runtime.models.skeleton.tree import Tree


class HumanSrl:
    """Human and arms in one tree. 72 nodes and two arms of seven joints give 90 nodes and 89 segments.

    Attributes:
        human: the human's tree alone.
        arms: the arms.
        tree: both.
        joints: (k,) indices in `tree` of the human's joints, in the suit's order.
        sites: (m,) indices in `tree` of the human's end sites.
        arm: by side, the indices in `tree` of Base, J1 to Jn, End.
    """

    def __init__(self, human: Tree, arms: Arms) -> None:
        """
        Raises:
            OptionError: the human has no node on which the arms could hang.
        """
        valid = [human.names[i] for i in human.joints]
        if arms.parent not in valid:
            raise OptionError(f"the body has no node '{arms.parent}'", nearest(arms.parent, valid))
        self.human, self.arms = human, arms
        try:
            self.tree = human.with_branch(arms.parent, [node for side in SIDES for node in arms.branch(side)])
        except ValueError as error:
            raise OptionError(str(error), "Give the body's nodes other names") from None
        self.joints = np.array([self.tree.index(human.names[i]) for i in human.joints])
        self.sites = np.array([i for i, node in enumerate(self.tree.nodes) if node.end and node.name in human.names])
        self.arm: dict[Side, slice] = {}
        for side in SIDES:
            first = self.tree.index(arms.names(side)[0])
            self.arm[side] = slice(first, first + arms.n + 2)

    @property
    def labels(self) -> tuple[str, ...]:
        """(k): names of the human's joints, in the suit's order."""
        return tuple(self.tree.names[i] for i in self.joints)

    @property
    def groups(self) -> tuple[str, ...]:
        """(nodes): the part that each node belongs to: "body", "right SRL", "left SRL"."""
        sides = {i: f"{side} SRL" for side, nodes in self.arm.items() for i in range(nodes.start, nodes.stop)}
        return tuple(sides.get(i, "body") for i in range(len(self.tree)))

    @property
    def lines(self) -> tuple[tuple[int, ...], ...]:
        """Lines through the nodes, for pictures: those of the tree without the arms that don't exist."""
        absent = {
            i for side, own in self.arm.items() if side not in self.arms.sides for i in range(own.start, own.stop)
        }
        return tuple(line for line in self.tree.polylines if not absent & set(line))

    def whole(self, rotation: Array, translation: Array, arms: Mapping[Side, Array]) -> tuple[Array, Array]:
        """The motion of all nodes in their parents, for many frames at once: the arms' joints are rotations, too.

        Args:
            rotation: (frames, k, 4) unit quaternions of the human's joints.
            translation: (frames, k, 3) m, of the same.
            arms: (frames, n) rad or m, by side; an arm that isn't given is at zero.

        Returns:
            (frames, nodes, 4) unit quaternions, (frames, nodes, 3) m.
        """
        n = len(rotation)
        turns = np.tile([1.0, 0.0, 0.0, 0.0], (n, len(self.tree), 1))
        places = np.tile(self.tree.offsets, (n, 1, 1))
        turns[:, self.joints], places[:, self.joints] = rotation, translation
        for side, angles in arms.items():
            first = self.arm[side].start + 1
            for i, (joint, axis) in enumerate(zip(self.arms.joints, self.arms.axes(side), strict=True)):
                q = angles[:, i, None]
                if joint.slides:
                    places[:, first + i + 1] += q * axis
                else:
                    turns[:, first + i] = np.concatenate([np.cos(q / 2), np.sin(q / 2) * axis], axis=1)
        return turns, places
