"""The human skeleton of 72 nodes: the 59 joints that Axis Neuron sends, and 13 end sites.

Offsets are those of the paper's body (hips at 0.957 m; the software's template), symmetrical: the template's right
shank is 1.6 cm shorter, so that its foot would hang above the floor.
"""

from __future__ import annotations

from typing import Final

from srl.runtime.models.skeleton.tree import Node, Tree

# name, parent, offset in cm; a name that ends in _End is an end site
_Row = tuple[str, str, tuple[float, float, float]]
_LEG: Final[tuple[_Row, ...]] = (  # the left one; what is right is its mirror image in x
    ("UpLeg", "Hips", (9.625, -1.639, 0.0)),
    ("Leg", "UpLeg", (0.0, -43.12, 0.0)),
    ("Foot", "Leg", (0.0, -43.12, 0.0)),
    ("Foot_End", "Foot", (0.0, -7.85, 17.85)),
)
_TRUNK: Final[tuple[_Row, ...]] = (
    ("Spine", "Hips", (0.0, 16.395, 0.0)),
    ("Spine1", "Spine", (0.0, 10.023, 0.0)),
    ("Spine2", "Spine1", (0.0, 10.437, 0.0)),
    ("Spine3", "Spine2", (0.0, 10.023, 0.0)),
    ("Neck", "Spine3", (0.0, 10.713, 0.0)),
    ("Head", "Neck", (0.0, 9.72, 0.0)),
    ("Head_End", "Head", (0.0, 16.45, 0.0)),
)
_ARM: Final[tuple[_Row, ...]] = (
    ("Shoulder", "Spine3", (3.275, 7.142, 0.0)),
    ("Arm", "Shoulder", (13.1, 0.0, 0.0)),
    ("ForeArm", "Arm", (27.25, 0.0, 0.0)),
    ("Hand", "ForeArm", (26.75, 0.0, 0.0)),
    ("HandThumb1", "Hand", (2.56, 0.196, 3.21)),
    ("HandThumb2", "HandThumb1", (3.788, 0.0, 0.0)),
    ("HandThumb3", "HandThumb2", (2.631, 0.0, 0.0)),
    ("HandThumb3_End", "HandThumb3", (2.256, 0.0, 0.0)),
    ("InHandIndex", "Hand", (3.316, 0.523, 2.035)),
    ("HandIndex1", "InHandIndex", (5.366, -0.094, 1.028)),
    ("HandIndex2", "HandIndex1", (3.723, 0.0, 0.0)),
    ("HandIndex3", "HandIndex2", (2.111, 0.0, 0.0)),
    ("HandIndex3_End", "HandIndex3", (1.857, 0.0, 0.0)),
    ("InHandMiddle", "Hand", (3.479, 0.532, 0.778)),
    ("HandMiddle1", "InHandMiddle", (5.322, -0.086, 0.323)),
    ("HandMiddle2", "HandMiddle1", (4.062, 0.0, 0.0)),
    ("HandMiddle3", "HandMiddle2", (2.547, 0.0, 0.0)),
    ("HandMiddle3_End", "HandMiddle3", (2.031, 0.0, 0.0)),
    ("InHandRing", "Hand", (3.461, 0.553, -0.133)),
    ("HandRing1", "InHandRing", (4.767, -0.023, -0.493)),
    ("HandRing2", "HandRing1", (3.541, 0.0, 0.0)),
    ("HandRing3", "HandRing2", (2.456, 0.0, 0.0)),
    ("HandRing3_End", "HandRing3", (1.91, 0.0, 0.0)),
    ("InHandPinky", "Hand", (3.251, 0.483, -1.236)),
    ("HandPinky1", "InHandPinky", (4.259, -0.023, -1.122)),
    ("HandPinky2", "HandPinky1", (2.835, 0.0, 0.0)),
    ("HandPinky3", "HandPinky2", (1.792, 0.0, 0.0)),
    ("HandPinky3_End", "HandPinky3", (1.692, 0.0, 0.0)),
)


def human(scale: float = 1.0) -> Tree:
    """The 72 nodes in the order of the suit's files and stream: the right leg, the left, the trunk, right arm, left."""
    rows: list[_Row] = [("Hips", "", (0.0, 95.729, 0.0))]
    for branch, above in ((_LEG, "Hips"), (_TRUNK, ""), (_ARM, "Spine3")):
        if not above:
            rows += branch
            continue
        for side, sign in (("Right", -1.0), ("Left", 1.0)):
            rows += [
                (side + name, up if up == above else side + up, (sign * x, y, z)) for name, up, (x, y, z) in branch
            ]
    k = scale / 100.0
    return Tree(Node(name, up, (k * x, k * y, k * z), name.endswith("_End")) for name, up, (x, y, z) in rows)
