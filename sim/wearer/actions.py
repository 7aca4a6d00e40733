"""The postures of a whole body: at ease, and each of the ten actions. Angles are ours, within people's ranges.

Angles are degrees (59, 3) about Y, X, Z of each joint in its parent, R = Ry Rx Rz, from the suit's T-pose: y up, z
forward, x to the body's left. What is said of the left side is mirrored for the right: Y and Z change sign.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Action

HANG: Final = 72.0  # degrees from the T-pose to arms at the sides
_ELBOW: Final = 15.0  # degrees, bent at ease
_FINGERS: Final = ("Index", "Middle", "Ring", "Pinky")
WAVES: Final = 25.0  # degrees, the forearm to either side
Angles = tuple[float, float, float]

# Per joint, Y, X, Z beyond the posture at ease. `Both...` is meant for the left side, and mirrored.
_POSES: Final[dict[Action, dict[str, Angles]]] = {
    "overhead": {"BothArm": (-20.0, 0.0, HANG + 65.0), "BothForeArm": (-10.0, 0.0, 0.0), "Spine1": (0.0, -4.0, 0.0)},
    "forward": {"BothArm": (-78.0, 0.0, HANG - 8.0), "BothForeArm": (5.0, 0.0, 0.0), "Spine": (0.0, 4.0, 0.0)},
    "reach-left": {
        "LeftArm": (-10.0, 0.0, HANG - 5.0), "LeftForeArm": (8.0, 0.0, 0.0), "Spine": (4.0, 0.0, -6.0),
        "Spine1": (4.0, 0.0, -4.0),
    },
    "reach-right": {
        "RightArm": (10.0, 0.0, 5.0 - HANG), "RightForeArm": (-8.0, 0.0, 0.0), "Spine": (-4.0, 0.0, 6.0),
        "Spine1": (-4.0, 0.0, 4.0),
    },
    "carry": {"BothArm": (-6.0, -10.0, -4.0), "BothForeArm": (-72.0, 0.0, 0.0), "Spine": (0.0, -4.0, 0.0)},
    "bend": {
        "Hips": (0.0, 25.0, 0.0), "BothUpLeg": (0.0, -20.0, 0.0), "BothLeg": (0.0, 8.0, 0.0),
        "Spine": (0.0, 12.0, 0.0), "Spine1": (0.0, 12.0, 0.0), "Spine2": (0.0, 10.0, 0.0),
        "BothArm": (0.0, -55.0, 0.0),
    },
    "squat": {
        "Hips": (0.0, 15.0, 0.0), "Spine": (0.0, 6.0, 0.0), "BothUpLeg": (0.0, -85.0, 0.0),
        "BothLeg": (0.0, 105.0, 0.0), "BothFoot": (0.0, -35.0, 0.0), "BothArm": (-35.0, -15.0, 12.0),
    },
    "turn-left": {
        "Hips": (15.0, 0.0, 0.0), "Spine": (12.0, 0.0, 0.0), "Spine1": (12.0, 0.0, 0.0),
        "Spine2": (10.0, 0.0, 0.0), "Head": (15.0, 0.0, 0.0), "BothForeArm": (-20.0, 0.0, 0.0),
    },
    "turn-right": {
        "Hips": (-15.0, 0.0, 0.0), "Spine": (-12.0, 0.0, 0.0),
        "Spine1": (-12.0, 0.0, 0.0), "Spine2": (-10.0, 0.0, 0.0), "Head": (-15.0, 0.0, 0.0),
        "BothForeArm": (-20.0, 0.0, 0.0),
    },
    "wave": {"RightArm": (15.0, -80.0, 10.0 - HANG), "RightForeArm": (60.0, 0.0, 0.0)},
}  # fmt: skip


def at_ease(index: Mapping[str, int]) -> Array:
    """The angles of a person who stands at ease; `index`: of each joint by name."""
    angles = np.zeros((JOINTS, 3))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        angles[index[f"{side}Arm"]] = 0.0, 0.0, -sign * HANG
        angles[index[f"{side}ForeArm"]] = -sign * _ELBOW, 0.0, 0.0
        for finger in _FINGERS:
            for k, bend in enumerate((15.0, 25.0, 15.0)):
                angles[index[f"{side}Hand{finger}{k + 1}"], 2] = -sign * bend
    return angles


def beyond_ease(action: Action, index: Mapping[str, int]) -> Array:
    """What an action adds to the posture at ease."""
    angles = np.zeros((JOINTS, 3))
    for name, (y, x, z) in _POSES[action].items():
        if name.startswith("Both"):
            part = name.removeprefix("Both")
            angles[index[f"Left{part}"]] = y, x, z
            angles[index[f"Right{part}"]] = -y, x, -z
        else:
            angles[index[name]] = y, x, z
    return angles


def waving(action: Action, index: Mapping[str, int]) -> Array:
    """The amplitude of what an action repeats while it goes on."""
    angles = np.zeros((JOINTS, 3))
    if action == "wave":
        angles[index["RightForeArm"], 0] = WAVES
    return angles
