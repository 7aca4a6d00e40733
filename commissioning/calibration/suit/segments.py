"""The segments of a suit that have sensors of their own, and how each is turned in the suit's world."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array


class SuitError(SrlError):
    """A suit can't be used as it is, or its calibration can't be computed."""


def segments(joints: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Names of the segments and each one's parent among them (-1: none): hips, legs, trunk, neck, head, arms.

    Args:
        joints: a suit's joints in its order; fingers are left out. Trunk and neck may have any number.
    Raises:
        SuitError: one is missing.
    """
    trunk = [name for name in joints if name.startswith("Spine")]
    neck = [*(name for name in joints if name.startswith("Neck")), "Head"]
    chest = trunk[-1] if trunk else "Spine"
    chains = [("Hips", *(trunk or ["Spine"]), *neck)]
    for side in ("Right", "Left"):
        chains.append(("Hips", *(f"{side}{part}" for part in ("UpLeg", "Leg", "Foot"))))
        chains.append((chest, *(f"{side}{part}" for part in ("Shoulder", "Arm", "ForeArm", "Hand"))))
    found: dict[str, int] = {"Hips": -1}
    for chain in chains:
        for up, name in pairwise(chain):
            found[name] = list(found).index(up)
    if missing := [name for name in found if name not in joints]:
        raise SuitError("suit", f"it has no joint '{missing[0]}'", "Use a suit of the whole body")
    return tuple(found.items())


def chest(names: Sequence[str]) -> int:
    """The number of the last segment of the trunk."""
    return max(i for i, name in enumerate(names) if name.startswith("Spine"))


def in_world(rotation: Array, parents: Sequence[int]) -> Array:
    """(T, n, 4) w x y z in the suit's world, of rotations (T, n, 4) in the parents; a parent comes first."""
    made = np.empty_like(rotation)
    for i, up in enumerate(parents):
        made[:, i] = rotation[:, i] if up < 0 else product(made[:, up], rotation[:, i])
    return made


def product(a: Array, b: Array) -> Array:
    """Quaternion products (..., 4) w x y z: b, followed by a."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def back(q: Array) -> Array:
    """The inverse of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def mean(q: Array) -> Array:
    """(n, 4): the mean of unit quaternions (T, n, 4) that are near each other, whatever their signs."""
    signs = np.where(np.einsum("tnk,nk->tn", q, q[0]) < 0.0, -1.0, 1.0)
    found: Array = (q * signs[..., None]).mean(axis=0)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def heading(q: Array) -> Array:
    """(...) rad, -pi to pi: the turn about y (up) of unit quaternions (..., 4), apart from a tilt (swing-twist)."""
    twice = 2.0 * np.arctan2(q[..., 2], q[..., 0])
    found: Array = (twice + np.pi) % (2.0 * np.pi) - np.pi
    return found


def tilt(q: Array) -> Array:
    """(...) rad: what is left of unit quaternions (..., 4) without their turn about y."""
    found: Array = 2.0 * np.arccos(np.clip(np.hypot(q[..., 0], q[..., 2]), 0.0, 1.0))
    return found


def along(q: Array, direction: Sequence[float]) -> Array:
    """(..., 3): where a direction (3,) of a segment's own points in the world."""
    v = np.asarray(direction, float)
    axis = q[..., 1:]
    once = 2.0 * np.cross(axis, v)
    found: Array = v + q[..., :1] * once + np.cross(axis, once)
    return found
