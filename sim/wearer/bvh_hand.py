"""The hand of a motion-capture skeleton (Axis Neuron's names), as the model's 20 joint angles."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS, JOINTS
from srl.runtime.models.skeleton import bvh

_BONES: Final = {"thumb": "Thumb", "index": "Index", "middle": "Middle", "ring": "Ring", "little": "Pinky"}
_MOVES: Final = np.deg2rad(5.0)  # a hand whose joints all move less than this was not measured

# Rows: toward the little finger, distal, dorsal, in the skeleton's axes (T-pose: X left, Y up, Z forward,
# palms down, thumbs forward). For the left hand the basis is left-handed: in this basis, the hand is its mirror
# image, which is a right hand, and B R B^T is again a rotation.
_BASIS: Final = {
    "Left": np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]]),
    "Right": np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]),
}


def read(path: Path) -> list[tuple[Array, Array]]:
    """Reads one section: time (n,), s, and position (n, 20), rad, of the hand that moves more.

    Raises:
        RecordingError: there are no finger bones, or none that move.
    """
    file = bvh.read(path)
    hands = {side: hand_angles(file, side) for side in _BASIS if _has_fingers(file, side)}
    if not hands:
        raise RecordingError(
            str(path), "the skeleton has no finger bones (LeftHandIndex1, ...)", "Record with finger sensors"
        )
    side = max(hands, key=lambda name: float(np.ptp(hands[name], axis=0).sum()))
    if np.ptp(hands[side], axis=0).max() < _MOVES:
        raise RecordingError(
            str(path),
            "no finger moves by more than 5 degrees",
            "Record with finger sensors worn and switched on",
        )
    time = np.arange(len(file.frames), dtype=float) * file.frame_time
    return [(time, hands[side])]


def hand_angles(file: bvh.Bvh, side: str) -> Array:
    """(n, 20), rad, without limits: the angles of one hand, converted to those of a right hand.

    Each bone's rotation relative to its parent turns the distal axis y into d. At a knuckle, abduction a and
    flexion f are those with d = Rz(a) Rx(-f) y. At the other joints, flexion is the angle of d in the plane of
    bending; for the thumb's two outer joints this is the plane of the palm.

    Args:
        file: the recording.
        side: "Left" or "Right".
    """
    q = np.zeros((len(file.frames), len(JOINTS)))
    for number, finger in enumerate(FINGERS):
        d = [_direction(file, side, finger, k) for k in (1, 2, 3)]
        abduction, flexion = _knuckle(d[0])
        q[:, 4 * number], q[:, 4 * number + 1] = abduction, flexion
        for k in (1, 2):
            bent = d[k][:, 0] if finger == "thumb" else -d[k][:, 2]
            q[:, 4 * number + 1 + k] = np.arctan2(bent, d[k][:, 1])
    return q


def _knuckle(d: Array) -> tuple[Array, Array]:
    """Abduction and flexion (n,), rad, of distal directions d (n, 3).

    Near a right angle of flexion the finger points along the abduction axis, and abduction has no meaning. So it is
    reduced to zero from 66 to 84 degrees, as in an anatomical hand.
    """
    radial = np.hypot(d[:, 0], d[:, 1])  # cos f, seen along the abduction axis
    fade = np.clip((radial - 0.1) / 0.3, 0.0, 1.0)
    fade = np.where(d[:, 1] > 0, fade * fade * (3 - 2 * fade), 0.0)
    abduction = fade * np.arctan2(-d[:, 0], np.abs(d[:, 1]))
    forward = d[:, 1] * np.cos(abduction) - d[:, 0] * np.sin(abduction)
    return abduction, np.arctan2(-d[:, 2], forward)


def _direction(file: bvh.Bvh, side: str, finger: str, k: int) -> Array:
    """(n, 3): the distal axis as turned by a bone, in (little, distal, dorsal) of its parent."""
    B = _BASIS[side]
    R = file.rotation(file.index(f"{side}Hand{_BONES[finger]}{k}"))
    return (B @ R @ B.T)[:, :, 1]


def _has_fingers(file: bvh.Bvh, side: str) -> bool:
    return all(file.index(f"{side}Hand{bone}{k}") >= 0 for bone in _BONES.values() for k in (1, 2, 3))
