"""How thick a person is at each joint, so that a skeleton of a whole body is drawn as a body.

Our figures for an adult, for pictures alone: what keeps an arm clear of a person has radii of its own
(docs/collision.md).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

_SIDE: Final = re.compile("^(Right|Left)")
_END: Final = re.compile("(_End|[0-9])+$")
# m, by the names of motion capture's nodes without side, number and end.
RADII: Final = {
    "Hips": 0.115, "Spine": 0.115, "Neck": 0.055, "Head": 0.085, "Shoulder": 0.065, "Arm": 0.05, "ForeArm": 0.04,
    "Hand": 0.03, "UpLeg": 0.085, "Leg": 0.055, "Foot": 0.04, "InHandIndex": 0.014, "InHandMiddle": 0.014,
    "InHandRing": 0.014, "InHandPinky": 0.013, "HandThumb": 0.011, "HandIndex": 0.01, "HandMiddle": 0.01,
    "HandRing": 0.01, "HandPinky": 0.009,
}  # fmt: skip


def thicknesses(names: Sequence[str]) -> tuple[float | None, ...]:
    """A radius, m, for each of the nodes; None for one that is no person's. Empty where hips or spine are missing."""
    found = tuple(RADII.get(_END.sub("", _SIDE.sub("", name))) for name in names)
    return found if {"Hips", "Spine"} <= set(names) else ()
