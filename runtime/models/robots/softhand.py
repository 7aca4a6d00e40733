"""The SoftHand's shape: palm, knuckles and rolling joints, and how the joints of the empty hand follow its closure.

Dimensions: the published description of the Pisa/IIT SoftHand. What is our own choice says so.
"""

from __future__ import annotations

from math import radians, sqrt
from typing import Final

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.linkage import DARK, Link, Linkage, Solid
from srl.runtime.contracts.rotation import Pose, Vector

NAME: Final = "softhand"
CLOSURE: Final = "closure"
"""The element of the recorded angles: 0 open, 1 closed."""
FINGERS: Final = ("thumb", "index", "middle", "ring", "little")
FULL: Final = radians(45)
"""rad, each hinge of the closed hand; also its end stop. A rolling joint is a pair of equal hinges."""
PALM: Final = ((0.002, 0.00695, 0.0535), (0.0365, 0.0911, 0.0848))
"""m: position in the base, size."""
# Knuckle in the palm (m), and the share of the synergy by which it swings sideways: fingers come together.
KNUCKLES: Final[dict[str, tuple[Vector, float]]] = {
    "thumb": ((0.00566972, 0.029616, 0.055314), 1.3),
    "index": ((-0.0033, 0.0195, 0.0936994), -0.2),
    "middle": ((-0.0033, 0.0, 0.100699), 0.0),
    "ring": ((-0.0033, -0.0195, 0.0936994), 0.2),
    "little": ((-0.0033, -0.039, 0.0836994), 0.4),
}
PAIRS: Final = {finger: ("inner", "outer") if finger == "thumb" else ("inner", "middle", "outer") for finger in FINGERS}
FACTOR: Final = {("thumb", "inner"): 1.3}
"""The share of the synergy; all other flexions follow it itself."""
_THUMB: Final = (0.97, 0.24)  # direction of the open thumb: radial, distal; our own choice
ROLL, PHALANX, KNUCKLE, TIP = 0.013, 0.009, 0.009, 0.024  # m
RADIUS: Final = 0.008  # m, of phalanges; the published boxes are 14 to 19 mm thick
FLEXION: Final[Vector] = (0.0, 1.0, 0.0)


def thumb() -> tuple[float, float]:
    """The open thumb's direction, radial and distal, of length 1."""
    y, z = _THUMB
    return y / sqrt(y * y + z * z), z / sqrt(y * y + z * z)


def linkage() -> Linkage:
    """The empty hand. A finger that an object holds back is drawn as if it weren't: nothing measures it.

    The hand's frame: z along the fingers, y to the thumb's side, x out of the palm.
    """
    place, size = PALM
    x, y, z = place
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    wrist = Solid("cylinder", (0.03, z / 2), (0.0, 0.0, z / 2, 1.0, 0.0, 0.0, 0.0), DARK)
    links = [
        Link("base", -1, solids=(wrist,)),
        Link("palm", 0, (x, y, z, *IDENTITY[3:]), solids=(Solid("box", half, (0.0, 0.0, half[2], *IDENTITY[3:])),)),
    ]
    for finger, (knuckle, swing) in KNUCKLES.items():
        up, along = thumb()
        if finger == "thumb":
            turn = rotation.from_matrix(np.array([[1.0, 0.0, 0.0], [0.0, along, up], [0.0, -up, along]]))
            pose, axis = (*knuckle, *turn), (0.0, up, -along)
        else:
            pose, axis = (*knuckle, *IDENTITY[3:]), (-1.0, 0.0, 0.0)
        links.append(_hinge(f"{finger}_abduction", 1, pose, axis, swing, KNUCKLE))
        at = KNUCKLE
        for pair in PAIRS[finger]:
            share = min(FACTOR.get((finger, pair), 1.0), 1.0)  # the hinge's end stop
            for number in ("1", "2"):
                first = number == "1"
                reach = 0.0 if first else TIP if pair == "outer" else PHALANX
                along_z: Pose = (0.0, 0.0, at, *IDENTITY[3:])
                links.append(_hinge(f"{finger}_{pair}_{number}", len(links) - 1, along_z, FLEXION, share, reach))
                at = ROLL if first else PHALANX
    return Linkage(tuple(links))


def _hinge(name: str, parent: int, pose: Pose, axis: Vector, share: float, reach: float) -> Link:
    phalanx = Solid("capsule", (RADIUS, reach / 2), (0.0, 0.0, reach / 2, *IDENTITY[3:]))
    joint = CLOSURE if share else ""
    return Link(name, parent, pose, joint, axis, factor=share * FULL, solids=(phalanx,))
