"""From a suit's poses to features of a window of motion.

A posture is described by directions alone: where up is for hips and chest, where the chest faces from the hips, where
the bones of arms and legs point from the chest and the hips. So nothing depends on where a person stands or faces, on
the size, or on a quaternion's sign. What is left of the path, the way over the window as seen from the hips and in leg
lengths, tells walking.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, product, turned
from srl.runtime.contracts.signals import Array

LIMBS: Final = tuple(
    f"{side}{part}"
    for side in ("Left", "Right")
    for part in ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")
)
POSTURE: Final = 33  # numbers that describe a posture
_PLACE: Final = 6  # behind them in a frame: the hips' position in leg lengths, and where they face, both in the world
FRAME: Final = POSTURE + _PLACE
RATE: Final = 20.0  # Hz, of the frames in a window
FRAMES: Final = 20  # in a window: 1 s
FEATURES: Final = 3 * POSTURE + 3
_UP: Final = (0.0, 1.0, 0.0)
_AHEAD: Final = (0.0, 0.0, 1.0)


def joints(trunk: Sequence[str]) -> tuple[str, ...]:
    """The joints that are described, in the order of `frame`; `trunk`: from above the hips to where the arms begin."""
    return ("Hips", *LIMBS, *trunk)


def trunk_of(labels: Sequence[str]) -> tuple[str, ...]:
    """The trunk among a suit's joints."""
    return tuple(name for name in labels if name.startswith("Spine"))


def frame(rotation: Sequence[Sequence[Any]], translation: Sequence[Sequence[Any]]) -> list[Any]:
    """One posture and place as FRAME numbers.

    Args:
        rotation: w, x, y, z of each of `joints` in its parent, unit quaternions; numbers, or arrays of many samples.
        translation: x, y, z, m, of each in its parent.
    """
    hips, *q = map(_quaternion, rotation)
    place, *p = translation
    back = (hips[0], -hips[1], -hips[2], -hips[3])
    chest = q[len(LIMBS)]
    for each in q[len(LIMBS) + 1 :]:
        chest = product(chest, each)
    down = (chest[0], -chest[1], -chest[2], -chest[3])
    up = turned(back, _UP)
    made: list[Any] = [*up, *turned(down, up), *turned(chest, _AHEAD)]
    length: Any = 0.0
    for side in (0, 7):
        shoulder, arm, forearm, _, thigh, shank, _ = q[side : side + 7]
        _, _, elbow, wrist, _, knee, ankle = p[side : side + 7]
        upper = product(shoulder, arm)
        for turn, bone in ((upper, elbow), (product(upper, forearm), wrist), (thigh, knee),
                           (product(thigh, shank), ankle)):  # fmt: skip
            size = (bone[0] * bone[0] + bone[1] * bone[1] + bone[2] * bone[2]) ** 0.5 + 1e-9
            x, y, z = turned(turn, (bone[0], bone[1], bone[2]))
            made += (x / size, y / size, z / size)
            if bone is knee or bone is ankle:
                length = length + 0.5 * size
    made += (place[0] / length, place[1] / length, place[2] / length, *turned(hips, _AHEAD))
    return made


def _quaternion(each: Sequence[Any]) -> Quaternion:
    return (each[0], each[1], each[2], each[3])


def frames(rotation: Array, translation: Array) -> Array:
    """Frames (T, FRAME) of samples (T, n, 4) and (T, n, 3), of the joints `joints`."""
    made = frame([tuple(each) for each in rotation.transpose(1, 2, 0)],
                 [tuple(each) for each in translation.transpose(1, 2, 0)])  # fmt: skip
    return np.stack(made, axis=1)


_RAMP: Final = np.linspace(-1.0, 1.0, FRAMES)
_WEIGHTS: Final = np.stack([np.full(FRAMES, 1.0 / FRAMES), 2.0 * _RAMP / (_RAMP @ _RAMP)])


def features(window: Array) -> Array:
    """Features (FEATURES,) of a window (FRAMES, FRAME): mean, trend and spread of the posture, and the way.

    The trend is twice the slope over the window, the spread what is left beside it.
    """
    posture = window[:, :POSTURE]
    mean, trend = _WEIGHTS @ posture
    spread = np.maximum(np.einsum("ij,ij->j", posture, posture) / FRAMES - mean * mean - _TRENDS * trend * trend, 0.0)
    x, y, z = (window[-1, POSTURE : POSTURE + 3] - window[0, POSTURE : POSTURE + 3]).tolist()
    ahead, _, aside = window[-1, POSTURE + 3 :].tolist()
    size = (ahead * ahead + aside * aside) ** 0.5 + 1e-9
    s, c = ahead / size, aside / size  # the heading: forward is (s, c) in x and z
    return np.concatenate([mean, trend, np.sqrt(spread + _LEAST), [s * x + c * z, y, c * x - s * z]])


_TRENDS: Final = float(_RAMP @ _RAMP) / FRAMES / 4.0
_LEAST: Final = 1e-4  # added to the variance of what doesn't move


def moved(found: Array) -> float:
    """How far the posture moved within a window: rms angle of the direction that moved most, rad, of `features`."""
    trend, spread = found[POSTURE : 2 * POSTURE], found[2 * POSTURE : 3 * POSTURE]
    variance = (_TRENDS * trend * trend + spread * spread - _LEAST).reshape(-1, 3).sum(axis=1)
    return float(max(variance.max(), 0.0) ** 0.5)
