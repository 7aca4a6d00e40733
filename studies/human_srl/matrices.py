"""The positions of the 90 nodes by plain matrices, from what is on the wire: it shares no code with the skeleton.

A human joint's frame is T_parent Trans(position) R, with R the product of elementary rotations in the order of the
channels (BVH). An arm follows the paper's eq. (1): T_child = T_parent Rot Trans, with the rotation of the child's row
(eqs. 6 to 9): J1 about x, J2 about z, J3 about y, J4 about x, J5 along the forearm, J6 about x, J7 about y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, radians, sin
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

# By node: the axis of the rotation in its row. The sliding joint is in the translation of row 7, J6's node.
_ROWS: Final = ("", "", "x", "z", "y", "x", "", "x", "y")
_NODES: Final = ("Base", "J1", "J2", "J3", "J4", "J5", "J6", "J7", "End")
_SLIDES: Final = 6  # index of the row
_TURNS: Final = (0, 1, 2, 3, 5, 6)  # joints that turn, in the order of their rows


def about(axis: str, angle: float) -> Array:
    """(4, 4): a rotation by rad about x, y or z."""
    c, s = cos(angle), sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    made = np.eye(4)
    made[i, i] = made[j, j] = c
    made[i, j], made[j, i] = -s, s
    return made


def moved(by: Sequence[float] | Array) -> Array:
    """(4, 4): a translation."""
    made = np.eye(4)
    made[:3, 3] = by
    return made


def body(
    names: Sequence[str], parents: Sequence[int], numbers: Array, order: str, sites: Mapping[str, tuple[str, Array]]
) -> dict[str, Array]:
    """The frames (4, 4) of a suit's joints and of the end sites, m.

    Args:
        names, parents: of the joints, a parent before its children; -1 for the root.
        numbers: (6 k,) of a frame: for each joint its position in cm and three angles in degrees, as `order` says.
        order: of the angles, such as "YXZ".
        sites: by name, the joint on which an end site is, and where, (3,) m.
    """
    found: dict[str, Array] = {}
    for name, up, row in zip(names, parents, numbers.reshape(-1, 6).tolist(), strict=True):
        frame = moved([0.01 * x for x in row[:3]])
        for axis, angle in zip(order.lower(), row[3:], strict=True):
            frame = frame @ about(axis, radians(angle))
        found[name] = frame if up < 0 else found[names[up]] @ frame
    return found | {name: found[up] @ moved(at) for name, (up, at) in sites.items()}


def arm(spine: Array, offsets: Array, q: Sequence[float], side: str) -> dict[str, Array]:
    """The frames (4, 4) of an arm's nodes by the paper's eq. (1).

    Args:
        spine: (4, 4) of the node that carries it.
        offsets: (9, 3) m, of the right arm's nodes, each in the node before.
        q: (7,) rad; m at J5, which lengthens the forearm.
        side: "right" or "left": its mirror image.
    """
    mirrored = side == "left"
    found, frame, turns = {}, spine, iter(_TURNS)
    for k, (name, axis, at) in enumerate(zip(_NODES, _ROWS, offsets.tolist(), strict=True)):
        x, y, z = at
        if k == _SLIDES:
            y -= q[4]
        turn = np.eye(4)
        if axis:
            angle = q[next(turns)]
            turn = about(axis, -angle if mirrored and axis != "x" else angle)
        frame = frame @ turn @ moved((-x if mirrored else x, y, z))
        found[f"{side[0].upper()}{name}"] = frame
    return found


def of_vector(
    rows: Mapping[str, Array], parents: Mapping[str, str], sites: Mapping[str, tuple[str, Array]]
) -> dict[str, Array]:
    """The frames (4, 4) that a reader of the paper computes from its motion vector, 540 numbers.

    Args:
        rows: by node, (6,): Xpos Ypos Zpos Zrot Xrot Yrot, cm and degrees.
        parents: by node, its parent; "" for the root. A parent comes before its children.
        sites: as `body`: the vector has zeros there.
    """
    found: dict[str, Array] = {}
    for name, up in parents.items():
        if name in sites:
            found[name] = found[up] @ moved(sites[name][1])
            continue
        row = rows[name]
        turn = about("z", radians(row[3])) @ about("x", radians(row[4])) @ about("y", radians(row[5]))
        # The rows of the arms' nodes follow eq. (1), those of the body the suit's files.
        of_arm = name[1:] in _NODES
        step = turn @ moved(0.01 * row[:3]) if of_arm else moved(0.01 * row[:3]) @ turn
        found[name] = found[up] @ step if up else step
    return found
