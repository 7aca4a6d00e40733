"""Limits of the arms, rad and rad/s. UR16e: facts sheet ur16e; the others: their data sheets, not checked again.

Each joint turns 360 degrees in either direction. The UR3e's last joint turns without end; here it has the same limit.
UR doesn't publish accelerations.
"""

from __future__ import annotations

from math import pi, radians
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

JOINTS: Final = (
    "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3",
)  # fmt: skip
REACH: Final = 2 * pi  # rad, in either direction, of every joint
_DEGREES: Final = {
    "UR3e": (180, 180, 180, 360, 360, 360),
    "UR5e": (180, 180, 180, 180, 180, 180),
    "UR10e": (120, 120, 180, 180, 180, 180),
    "UR16e": (120, 120, 180, 180, 180, 180),
}


def fastest(model: str) -> Array:
    """Returns the greatest joint velocities (6,), rad/s. Raises KeyError for an unknown model."""
    return np.array([radians(value) for value in _DEGREES[model]])


def same(model: str, name: str) -> bool:
    """Returns whether the dashboard's name of the model (UR16, UR16e) means this model."""
    return model.lower().removesuffix("e") == name.strip().lower().removesuffix("e")
