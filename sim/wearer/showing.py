"""A simulated person who shows a task: the right hand goes round before the chest, slowly, and comes down again.

Postures and times are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.wearer.motion import minimum_jerk

RAISED: Final = 1.0  # s, at which the hand begins to go up
BEGUN: Final = 3.0  # s, at which it begins to go round
ENDED: Final = 8.0  # s, at which it is round
LOWERED: Final = 10.0  # s, at which it is down again
_MOVE: Final = 1.5  # s to go up, and to come down
# Degrees that are added to the right arm at ease: the shoulder forward and up, the elbow bent.
_MIDDLE: Final = np.array([75.0, 42.0, 12.0])
_SWING: Final = np.array([12.0, 9.0, 8.0])


def showing(t: float, index: Mapping[str, int], joints: int) -> Array:
    """Degrees (joints, 3) about Y, X and Z that are added to the pose at ease at t seconds."""
    angles = np.zeros((joints, 3))
    up = _share(t, RAISED, _MOVE) - _share(t, LOWERED - _MOVE, _MOVE)
    around = 2.0 * np.pi * _share(t, BEGUN, ENDED - BEGUN)
    forward, high, bent = up * (_MIDDLE + _SWING * [np.cos(around), np.sin(around), np.sin(around)])
    angles[index["RightArm"]] = forward, 0.0, -high
    angles[index["RightForeArm"], 0] = bent
    return angles


def _share(t: float, begin: float, seconds: float) -> float:
    return float(minimum_jerk(np.array(min(max((t - begin) / seconds, 0.0), 1.0))))
