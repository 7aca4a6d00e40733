"""The tree of coordinate frames: mounts, mocap origin, chest, hand, tool, base.

A profile's `frames:` names each frame, its parent and its fixed transform. A frame whose pose is measured
names the signal that carries it; its fixed transform then comes first.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts.errors import ProfileError, nearest
from runtime.contracts.signals import Array


class FrameEntry(BaseModel):
    """`frames.<name>`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    parent: str | None = Field(None, description="null for a root")
    xyz: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="m, in the parent")
    rpy: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="rad, fixed axes x, y, z of the parent")
    pose: str | None = Field(None, description="signal (x, y, z, qw, qx, qy, qz) that measures it")


def transform(xyz: tuple[float, float, float], rpy: tuple[float, float, float]) -> Array:
    """The 4 x 4 transform T with p_parent = T p_child, rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    T = np.eye(4)
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = xyz
    return T


def from_pose(pose: Array) -> Array:
    """The 4 x 4 transform of (x, y, z, qw, qx, qy, qz); the quaternion is normalised first."""
    w, x, y, z = pose[3:] / np.linalg.norm(pose[3:])
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = pose[:3]
    return T


class Frames:
    """The tree, checked."""

    def __init__(self, entries: Mapping[str, FrameEntry], label: str) -> None:
        """Raises ProfileError for an unknown parent or a circle; `label` names the profile."""
        self.entries = dict(entries)
        self._fixed = {name: transform(e.xyz, e.rpy) for name, e in entries.items()}
        self._measured: dict[str, Array] = {}
        for name, entry in entries.items():
            if entry.parent is not None and entry.parent not in entries:
                remedy = nearest(entry.parent, entries)
                raise ProfileError(f"{label}: frames.{name}.parent", f"no frame is called '{entry.parent}'", remedy)
        for name in entries:
            self._path(name, label)

    def bind(self, signals: Mapping[str, Array]) -> None:
        """Takes the arrays of the signals that measure frames."""
        for name, entry in self.entries.items():
            if entry.pose is not None:
                self._measured[name] = signals[entry.pose]

    def lookup(self, target: str, source: str) -> Array:
        """The 4 x 4 transform T with p_target = T p_source, from what is measured now.

        Raises:
            KeyError: an unknown frame.
        """
        return np.linalg.inv(self._to_root(target)) @ self._to_root(source)

    def _to_root(self, name: str) -> Array:
        T = np.eye(4)
        at: str | None = name
        while at is not None:
            own = self._fixed[at]
            if at in self._measured:
                own = own @ from_pose(self._measured[at])
            T, at = own @ T, self.entries[at].parent
        return T

    def _path(self, name: str, label: str) -> None:
        seen = [name]
        while (parent := self.entries[seen[-1]].parent) is not None:
            if parent in seen:
                circle = " -> ".join([*seen, parent])
                raise ProfileError(
                    f"{label}: frames.{name}", f"the frames form a circle: {circle}", "Give one no parent"
                )
            seen.append(parent)
