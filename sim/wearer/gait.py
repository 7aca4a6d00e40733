"""A person's gait on a circle: what walking adds to a standing posture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

RADIUS: Final = 1.2  # m, of the circle that the person walks
SPEED: Final = 1.0  # m/s
STRIDES: Final = 0.85  # per second


def walked(t: float, start: float) -> float:
    """s of walking at full speed that have the length of the first t s, of which `start` lead up to it by minimum jerk.

    The integral of the minimum-jerk polynomial in t / start.
    """
    u = min(t / start, 1.0)
    return start * u**4 * (2.5 + u * (u - 3.0)) + max(t - start, 0.0)


def add_gait(
    hips: Array, angles: Array, index: Mapping[str, int], moving: float, gain: float, scale: float, speed: float = SPEED
) -> None:
    """Adds a gait to the hips (3,) m and to the joints' angles (59, 3) degrees about Y, X, Z.

    Args:
        hips, angles: of the standing person; changed.
        index: of each joint by name.
        moving: s of walking so far, at full speed.
        gain: 0 standing to 1 walking.
        scale: of the person; the circle grows with it.
        speed: m/s of a person of scale 1.
    """
    phase, turned = 2.0 * np.pi * STRIDES * moving, speed * moving / RADIUS
    hips += scale * np.array([RADIUS * (1.0 - np.cos(turned)), 0.0, RADIUS * np.sin(turned)])
    hips[1] -= 0.015 * scale * gain * (1.0 - np.cos(2.0 * phase))
    angles[0, 0] += np.rad2deg(turned)
    angles[index["Spine"], 0] += 6.0 * gain * np.sin(phase)
    for side, own in (("Left", phase), ("Right", phase + np.pi)):
        swing, sign = np.sin(own), 1.0 if side == "Left" else -1.0
        bent = (0.5 + 0.5 * np.cos(own)) ** 2  # in the swing phase, while the thigh moves forward
        angles[index[f"{side}UpLeg"], 1] -= gain * (24.0 * swing + 8.0)
        angles[index[f"{side}Leg"], 1] += gain * (6.0 + 55.0 * bent)
        angles[index[f"{side}Foot"], 1] -= gain * 12.0 * bent
        angles[index[f"{side}Arm"], 1] += gain * 20.0 * swing
        angles[index[f"{side}ForeArm"], 0] -= sign * gain * (10.0 - 8.0 * swing)
