"""A recorded motion as a capture suit of 59 joints gives it: from BVH, or from MVN's segments (MVNX)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

import numpy as np

from srl.drivers.noitom.skeleton import Kind, Skeleton
from srl.drivers.xsens_mvn import mvnx
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.rotation import Quaternion, conjugate, product
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton import bvh
from srl.runtime.models.skeleton.bvh import Bvh

CM: Final = 0.01
ENDINGS: Final = (".bvh", ".mvnx")
# The suit's axes (x left, y up, z forward) in MVN's (x forward, y left, z up).
_AXES: Final[Quaternion] = (0.5, 0.5, 0.5, 0.5)
_TRUNK: Final[dict[Kind, dict[str, str]]] = {
    "axis-neuron": {"L5": "Spine", "L3": "Spine1", "T12": "Spine2", "T8": "Spine3", "Neck": "Neck", "Head": "Head"},
    "axis-studio": {"L5": "Spine", "T12": "Spine1", "T8": "Spine2", "Neck": "Neck", "Head": "Head"},
}
_LIMBS: Final = {
    "Shoulder": "Shoulder", "UpperArm": "Arm", "ForeArm": "ForeArm", "Hand": "Hand",
    "UpperLeg": "UpLeg", "LowerLeg": "Leg", "Foot": "Foot",
}  # fmt: skip


@dataclass(frozen=True)
class SuitMotion:
    """A motion of n frames.

    Attributes:
        times: (n,) s from the first frame.
        offsets: (59, 3) m, of each joint in its parent, at rest.
        rotation: (n, 59, 4) w x y z of each joint in its parent, without jumps of the sign; of the hips in the suit's
            world (x left, y up, z forward).
        translation: (n, 59, 3) m, likewise.
    """

    times: Array
    offsets: Array
    rotation: Array
    translation: Array


def read(path: Path, skeleton: Skeleton) -> SuitMotion:
    """Reads a .bvh or .mvnx file.

    Raises:
        RecordingError: it can't be read, is of another kind, or lacks a joint of the skeleton.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        problem = f"'{path.suffix}' is no kind of a suit's recording"
        raise RecordingError(str(path), problem, f"Give {' or '.join(ENDINGS)}")
    return _of_bvh(path, skeleton) if ending == ".bvh" else of_mvnx(path, mvnx.read(path), skeleton)


def _of_bvh(path: Path, skeleton: Skeleton) -> SuitMotion:
    file = bvh.read(path)
    joints = rows(path, file, skeleton.names)
    offsets = np.array([file.joints[row].offset for row in joints]) * CM
    translation = np.stack([file.translation(row) for row in joints], axis=1) * CM
    times: Array = np.arange(len(file.frames), dtype=float) * file.frame_time
    return SuitMotion(times, offsets, rotations(path, file, joints), translation)


def of_mvnx(path: Path, file: mvnx.Mvnx, skeleton: Skeleton) -> SuitMotion:
    """The joints from MVN's segments; joints that MVN doesn't have are at rest. Raises RecordingError: one is missing.

    The bones are those of MVN's body: the mean over all frames. A joint without a segment has the standard body's.
    """
    joints = {"Pelvis": "Hips"} | _TRUNK[skeleton.kind]
    joints |= {side + own: side + joint for side in ("Right", "Left") for own, joint in _LIMBS.items()}
    if missing := [name for name in joints if name not in file.segments]:
        problem = f"it has no segment '{missing[0]}' ({len(missing)} missing)"
        raise RecordingError(str(path), problem, "Export all 23 segments of MVN's body")
    segment_of = {joint: file.segments.index(name) for name, joint in joints.items()}
    n, count = len(file.times), len(skeleton.names)
    world, place = np.empty((n, count, 4)), np.empty((n, count, 3))  # of the joints in the suit's world
    rotation, translation = np.zeros((n, count, 4)), np.empty((n, count, 3))
    rotation[..., 0] = 1.0
    translation[:] = skeleton.offsets
    for i, (name, up) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        if name in segment_of:
            at = segment_of[name]
            q = product(conjugate(_AXES), product(_columns(file.orientation[:, at]), _AXES))
            world[:, i] = np.stack(q, axis=-1)
            place[:, i] = file.position[:, at][:, [1, 2, 0]]
            rotation[:, i], translation[:, i] = world[:, i], place[:, i]
            if up >= 0:
                back = conjugate(_columns(world[:, up]))
                rotation[:, i] = np.stack(product(back, _columns(world[:, i])), axis=-1)
                translation[:, i] = _turned(back, place[:, i] - place[:, up])
        else:
            above = _columns(world[:, up])
            world[:, i] = world[:, up]
            place[:, i] = place[:, up] + _turned(above, translation[:, i])
    steady(rotation)
    offsets = translation.mean(axis=0)
    offsets[0] = skeleton.offsets[0]
    return SuitMotion(file.times, offsets, rotation, translation)


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
    steady(made)
    return made


def steady(rotation: Array) -> None:
    """Takes the jumps of the sign out of quaternions (n, k, 4), one k after another."""
    flip = np.sum(rotation[1:] * rotation[:-1], axis=2) < 0.0
    rotation[1:][np.cumsum(flip, axis=0) % 2 == 1] *= -1.0


def _columns(q: Array) -> Quaternion:
    return cast(Quaternion, tuple(q.T))  # arrays for numbers


def _turned(q: Quaternion, v: Array) -> Array:
    """(n, 3): vectors (n, 3) turned by rotations."""
    zero = np.zeros(len(v))
    point = cast(Quaternion, (zero, *v.T))
    _, x, y, z = product(product(q, point), conjugate(q))
    return np.stack([x, y, z], axis=-1)
