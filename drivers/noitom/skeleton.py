"""The 59 joints in wire order (sheet noitom_perception_neuron, 5).

Axes: y up, x to the body's left, z forward. With all rotations zero the body stands in the T-pose.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from srl.runtime.contracts.signals import Array

Kind = Literal["axis-neuron", "axis-studio"]

# name, parent's name, offset in cm from the parent; the default body of the software
_LEGS: Final = (
    ("Hips", "", (0.0, 91.43, 0.0)),
    ("RightUpLeg", "Hips", (-9.25, 0.0, 0.0)),
    ("RightLeg", "RightUpLeg", (0.0, -41.87, 0.0)),
    ("RightFoot", "RightLeg", (0.0, -41.87, 0.0)),
    ("LeftUpLeg", "Hips", (9.25, 0.0, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.0, -41.87, 0.0)),
    ("LeftFoot", "LeftLeg", (0.0, -41.87, 0.0)),
)
_TRUNK: Final[dict[str, tuple[tuple[str, str, tuple[float, float, float]], ...]]] = {
    "axis-neuron": (
        ("Spine", "Hips", (0.0, 14.782, 0.0)),
        ("Spine1", "Spine", (0.0, 10.003, 0.0)),
        ("Spine2", "Spine1", (0.0, 10.416, 0.0)),
        ("Spine3", "Spine2", (0.0, 10.003, 0.0)),
        ("Neck", "Spine3", (0.0, 10.692, 0.0)),
        ("Head", "Neck", (0.0, 9.47, 0.0)),
    ),
    "axis-studio": (
        ("Spine", "Hips", (0.0, 7.818, 0.0)),
        ("Spine1", "Spine", (0.0, 17.31, 0.0)),
        ("Spine2", "Spine1", (0.0, 12.285, 0.0)),
        ("Neck", "Spine2", (0.0, 18.427, 0.0)),
        ("Neck1", "Neck", (0.0, 4.735, 0.0)),
        ("Head", "Neck1", (0.0, 4.735, 0.0)),
    ),
}
_SHOULDER: Final = {"axis-neuron": ("Spine3", (2.792, 5.108, 0.0)), "axis-studio": ("Spine2", (2.792, 12.843, 0.0))}
_ARM: Final = (  # the left arm; the right one is its mirror image in x
    ("Arm", "Shoulder", (13.208, 0.0, 0.0)),
    ("ForeArm", "Arm", (26.5, 0.0, 0.0)),
    ("Hand", "ForeArm", (26.0, 0.0, 0.0)),
    ("HandThumb1", "Hand", (2.489, 0.19, 3.121)),
    ("HandThumb2", "HandThumb1", (3.683, 0.0, 0.0)),
    ("HandThumb3", "HandThumb2", (2.558, 0.0, 0.0)),
    ("InHandIndex", "Hand", (3.224, 0.508, 1.978)),
    ("HandIndex1", "InHandIndex", (5.217, -0.091, 0.999)),
    ("HandIndex2", "HandIndex1", (3.619, 0.0, 0.0)),
    ("HandIndex3", "HandIndex2", (2.052, 0.0, 0.0)),
    ("InHandMiddle", "Hand", (3.382, 0.517, 0.757)),
    ("HandMiddle1", "InHandMiddle", (5.174, -0.084, 0.314)),
    ("HandMiddle2", "HandMiddle1", (3.949, 0.0, 0.0)),
    ("HandMiddle3", "HandMiddle2", (2.476, 0.0, 0.0)),
    ("InHandRing", "Hand", (3.365, 0.538, -0.129)),
    ("HandRing1", "InHandRing", (4.635, -0.022, -0.479)),
    ("HandRing2", "HandRing1", (3.442, 0.0, 0.0)),
    ("HandRing3", "HandRing2", (2.388, 0.0, 0.0)),
    ("InHandPinky", "Hand", (3.161, 0.469, -1.202)),
    ("HandPinky1", "InHandPinky", (4.141, -0.022, -1.091)),
    ("HandPinky2", "HandPinky1", (2.757, 0.0, 0.0)),
    ("HandPinky3", "HandPinky2", (1.742, 0.0, 0.0)),
)
JOINTS: Final = 59


def is_finger(joint: str) -> bool:
    """Returns whether a joint is one of the 38 that only gloves measure."""
    return "Hand" in joint and not joint.endswith("Hand")


class Skeleton:
    """One of the two trees.

    Attributes:
        kind: which tree.
        names: (59) in wire order.
        parents: (59) indices, -1 for the hips; a parent comes before its children.
        offsets: (59, 3) m, each joint in its parent's frame; the hips' is their height in the T-pose.
    """

    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        rows = [*_LEGS, *_TRUNK[kind]]
        parent, offset = _SHOULDER[kind]
        for side, sign in (("Right", -1.0), ("Left", 1.0)):
            rows.append((f"{side}Shoulder", parent, (sign * offset[0], offset[1], offset[2])))
            rows += [(side + name, side + up, (sign * x, y, z)) for name, up, (x, y, z) in _ARM]
        self.names = tuple(name for name, _, _ in rows)
        index = {name: i for i, name in enumerate(self.names)}
        self.parents = tuple(index.get(up, -1) for _, up, _ in rows)
        self.offsets: Array = np.array([row[2] for row in rows]) / 100.0
