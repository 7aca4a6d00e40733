"""The joints of a suit in a BVH file of its software, as quaternions and in metres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.bvh import Bvh

CM = 0.01


def rows(path: Path, file: Bvh, names: Sequence[str]) -> list[int]:
    """The numbers of joints in a file. Raises RecordingError: one is missing."""
    found = [file.index(name) for name in names]
    missing = [name for name, row in zip(names, found, strict=True) if row < 0]
    if missing:
        raise RecordingError(
            str(path), f"it has no joint '{missing[0]}' ({len(missing)} missing)", "Give a file of this 'skeleton'"
        )
    return found


def rotations(path: Path, file: Bvh, joints: Sequence[int]) -> Array:
    """(n, k, 4) w x y z of joints in their parents, without jumps of the sign.

    Raises RecordingError: a joint hasn't three rotation channels, one an axis.
    """
    made = np.empty((len(file.frames), len(joints), 4))
    for i, row in enumerate(joints):
        channels = file.joints[row].rotations
        order = "".join("XYZ"[axis] for axis, _ in channels)
        if sorted(order) != ["X", "Y", "Z"]:
            raise RecordingError(
                f"{path}, joint {file.joints[row].name}",
                f"its rotation channels are '{order}'",
                "Expected X, Y and Z, each once",
            )
        made[:, i] = file.quaternions(row)
    flip = np.sum(made[1:] * made[:-1], axis=2) < 0.0
    made[1:][np.cumsum(flip, axis=0) % 2 == 1] *= -1.0
    return made
