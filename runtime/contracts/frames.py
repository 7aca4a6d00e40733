"""The tree of coordinate frames: mounts, mocap origin, chest, hand, tool, base.

A profile's `frames:` names each frame, its parent and its fixed transform. A frame whose pose is measured
also names the signal with that pose. Its transform is then the fixed one times the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts import rotation
from runtime.contracts.errors import ProfileError, nearest
from runtime.contracts.signals import Array


class FrameEntry(BaseModel):
    """One frame of the profile, `frames.<name>`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    parent: str | None = Field(None, description="null for a root")
    xyz: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="m, in the parent")
    rpy: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="rad, fixed axes x, y, z of the parent")
    pose: str | None = Field(None, description="signal (x, y, z, qw, qx, qy, qz) that measures it")

    def fixed(self) -> Array:
        """The fixed 4 x 4 transform T with p_parent = T p_child, without the measured pose."""
        return rotation.transform(self.xyz, rotation.from_rpy(self.rpy))


class Frames:
    """A checked tree of frames."""

    def __init__(self, entries: Mapping[str, FrameEntry], label: str) -> None:
        """Raises ProfileError for an unknown parent or a cycle. `label` names the profile."""
        self.entries = dict(entries)
        self._fixed = {name: e.fixed() for name, e in entries.items()}
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
        """The 4 x 4 transform T with p_target = T p_source, from the present measurements.

        Raises:
            KeyError: unknown frame.
        """
        return np.linalg.inv(self._to_root(target)) @ self._to_root(source)

    def _to_root(self, name: str) -> Array:
        T = np.eye(4)
        at: str | None = name
        while at is not None:
            own = self._fixed[at]
            if at in self._measured:
                own = own @ rotation.from_pose(self._measured[at])
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
