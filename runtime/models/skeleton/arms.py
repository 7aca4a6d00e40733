"""Supernumerary arms that hang on the body: nodes Base, J1 to Jn and End a side, left and right mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.tree import Node

Side = Literal["right", "left"]
SIDES: Final[tuple[Side, ...]] = ("right", "left")  # in the order of the nodes
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class ArmJoint:
    """One joint, as it is on the right arm.

    Attributes:
        at: m, its node in the frame of the node before it.
        axis: of the parent's frame at rest; a right-handed turn about it, or a displacement along it.
        slides: it is prismatic: it moves the next node, not its own.
    """

    at: Vector
    axis: Axis
    slides: bool = False

    @property
    def direction(self) -> Array:
        """(3,): the axis."""
        return np.array([(-1.0 if self.axis[0] == "-" else 1.0) * (self.axis[-1] == k) for k in "xyz"])


@dataclass(frozen=True)
class Arms:
    """Both arms.

    Attributes:
        parent: the node of the body on which the bases hang (the paper's BottomSpine).
        base: m, the right base in the parent's frame.
        joints: from the base on.
        end: m, the end in the last joint's frame.
        sides: the arms that exist; another one stays at zero.
    """

    parent: str
    base: Vector
    joints: tuple[ArmJoint, ...]
    end: Vector
    sides: tuple[Side, ...]

    @property
    def n(self) -> int:
        """Number of joints of one arm."""
        return len(self.joints)

    @property
    def labels(self) -> tuple[str, ...]:
        """(n): the joints' names, the same on both sides."""
        return tuple(f"J{i + 1}" for i in range(self.n))

    @property
    def slides(self) -> tuple[str, ...]:
        """The names of those that slide, in m."""
        return tuple(name for name, joint in zip(self.labels, self.joints, strict=True) if joint.slides)

    def side(self, named: Side | None) -> Side:
        """The side that an option names; the only one where it names none.

        Raises:
            OptionError: there is no such arm, or there are two and none is named: the other one's would be wrong.
        """
        if named is None and len(self.sides) > 1:
            raise OptionError("there are two arms, and nothing says which one is meant", "Add `side: right`, or left")
        if named is not None and named not in self.sides:
            raise OptionError(f"the arms have no {named} one", f"side: one of {', '.join(self.sides)}")
        return named or self.sides[0]

    def names(self, side: Side) -> tuple[str, ...]:
        """(n + 2): the names of one side's nodes, RBase, RJ1 and on."""
        return tuple(side[0].upper() + name for name in ("Base", *self.labels, "End"))

    def offsets(self, side: Side) -> Array:
        """(n + 2, 3) m: each node of one side in the frame of the node before it, at rest."""
        rows = np.array([self.base, *(joint.at for joint in self.joints), self.end])
        return rows * ([1.0, 1.0, 1.0] if side == "right" else [-1.0, 1.0, 1.0])

    def axes(self, side: Side) -> Array:
        """(n, 3): the joints' axes. Seen in a mirror, turns about x stay, those about y and z change sign."""
        rows = np.array([joint.direction for joint in self.joints])
        if side == "left":
            rows *= [[-1.0, 1.0, 1.0] if joint.slides else [1.0, -1.0, -1.0] for joint in self.joints]
        return rows + 0.0

    def branch(self, side: Side) -> tuple[Node, ...]:
        """The nodes of one side."""
        names, offsets = self.names(side), self.offsets(side).tolist()
        parents = (self.parent, *names[:-1])
        ends = [False] * (len(names) - 1) + [True]
        return tuple(
            Node(n, up, (x, y, z), e) for n, up, (x, y, z), e in zip(names, parents, offsets, ends, strict=True)
        )


# The paper gives the axes and no sizes; sizes are ours: 0.55 m from the shoulder to the end with J5 drawn in. The base
# is in front of the belly, so that a hanging forearm passes beside the arm.
STANDARD: Final = (
    ArmJoint((-0.05, 0.0, 0.0), "x"),
    ArmJoint((-0.04, 0.0, 0.0), "z"),
    ArmJoint((0.0, -0.05, 0.0), "y"),
    ArmJoint((0.0, -0.19, 0.0), "x"),
    ArmJoint((0.0, -0.06, 0.0), "-y", slides=True),
    ArmJoint((0.0, -0.13, 0.0), "x"),
    ArmJoint((0.0, -0.04, 0.0), "y"),
)
BASE: Final = (-0.10, -0.05, 0.20)
END: Final = (0.0, -0.08, 0.0)
