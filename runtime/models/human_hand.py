"""The 20-DoF "paradigmatic" human hand of the SynGrasp toolbox: geometry and ranges.

Frame `hand` (the paper's S0): origin at the wrist's centre of rotation, y distal, z dorsal (the palm faces
-z), x completes it. In a right hand x points toward the little finger, in a left hand toward the thumb.
"""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

FINGERS: Final = ("thumb", "index", "middle", "ring", "little")
POINTS: Final = ("wrist", *(f"{finger}_{joint}" for finger in FINGERS for joint in ("base", "middle", "distal", "tip")))
"""The wrist, then each finger's joints from its root to its tip: the order of MediaPipe's landmarks too."""

JOINTS: Final = tuple(
    f"{finger}_{joint}"
    for finger in FINGERS
    for joint in (
        ("tm_abduction", "tm_flexion", "mcp_flexion", "ip_flexion")
        if finger == "thumb"
        else ("mcp_abduction", "mcp_flexion", "pip_flexion", "dip_flexion")
    )
)
"""Positive flexion bends toward the palm. Positive abduction rotates toward the thumb's side."""

_GLOVE: Final = (
    *("thumb_roll", "thumb_mpj", "thumb_ij", "thumb_abduction"),
    *("index_mpj", "index_pij", "index_dij"),
    *("middle_mpj", "middle_pij", "middle_dij", "middle_index_abduction"),
    *("ring_mpj", "ring_pij", "ring_dij", "ring_middle_abduction"),
    *("pinkie_mpj", "pinkie_pij", "pinkie_dij", "pinkie_ring_abduction"),
    *("palm_arch", "wrist_pitch", "wrist_yaw"),
)
SENSORS: Final = {22: _GLOVE, 18: tuple(name for name in _GLOVE if not name.endswith("_dij"))}
"""A CyberGlove's sensors, by their number."""

FINGER_JOINTS: Final = ("abduction", "flexion_1", "flexion_2", "flexion_3")
"""The sixth finger's joints, from the wrist."""

MODEL_LENGTH: Final = 0.189
"""m, wrist crease to the middle fingertip of the unscaled model (165 mm of it from the wrist's centre)."""

# SynGrasp, SGparadigmatic: base origins and standard DH rows (alpha rad, a m). The thumb's third row puts
# its IP axis across the MCP axis. This is odd anatomically, but it is the published model.
_ORIGINS: Final = np.array(
    [
        [-0.037, 0.045, 0.0],
        [-0.024, 0.073, 0.0],
        [-0.008, 0.073, 0.0],
        [0.008, 0.073, 0.0],
        [0.024, 0.073, 0.0],
    ]
)
_BASE_ROTATION: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x distal
_ROWS: Final = np.array(
    [
        [[-pi / 2, 0.0], [0.0, 0.025], [pi / 2, 0.015], [0.0, 0.010]],
        [[-pi / 2, 0.0], [0.0, 0.037], [0.0, 0.030], [0.0, 0.015]],
        [[-pi / 2, 0.0], [0.0, 0.040], [0.0, 0.035], [0.0, 0.017]],
        [[-pi / 2, 0.0], [0.0, 0.037], [0.0, 0.030], [0.0, 0.015]],
        [[-pi / 2, 0.0], [0.0, 0.027], [0.0, 0.025], [0.0, 0.010]],
    ]
)

RANGES: Final[Array] = np.deg2rad(
    [
        *([-60, 30], [-15, 105], [-30, 80], [-10, 80]),
        *([-20, 25], [-30, 90], [0, 110], [-5, 80]),
        *([-15, 15], [-30, 90], [0, 110], [-5, 80]),
        *([-20, 15], [-30, 90], [0, 120], [-5, 80]),
        *([-35, 15], [-30, 90], [0, 125], [-5, 80]),
    ]
)
"""(20, 2) rad: lower and upper limit of each joint, in the order of JOINTS; a wearer's own are in `models:`. Our choice
after Cobos et al. (2008, 2010)
and MyoHand. It contains the mean posture of Santello et al. (1998)."""
RANGES.setflags(write=False)
BEYOND: Final = float(np.deg2rad(2.0))
"""rad: an angle further outside its joint's range than this is counted, and told."""


def hand_geometry(length: float = MODEL_LENGTH) -> tuple[Array, Array]:
    """Returns the geometry of a right hand's five fingers for a hand length (m), in the order of FINGERS.

    Returns:
        bases (5, 4, 4) in frame `hand`, m, and Denavit-Hartenberg rows (5, 4, 2), alpha (rad) and a (m).
    """
    scale = length / MODEL_LENGTH
    bases = np.tile(np.eye(4), (5, 1, 1))
    bases[:, :3, :3] = _BASE_ROTATION
    bases[:, :3, 3] = scale * _ORIGINS
    return bases, _ROWS * [1.0, scale]
