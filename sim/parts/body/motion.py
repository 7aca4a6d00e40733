"""How a simulated person moves: by a script, or as a suit recorded it.

A motion gives, in the suit's axes (y up, z forward, x to the left), the position of the hips and the rotation of
every joint relative to its parent, as functions of time only. The same time gives the same bits, in any order.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Final, Literal, Protocol

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS, Skeleton
from srl.drivers.replay import suit_motion
from srl.runtime.contracts.rotation import EulerQuaternions
from srl.runtime.contracts.signals import Array
from srl.sim.wearer.actions import at_ease
from srl.sim.wearer.gait import add_gait, walked
from srl.sim.wearer.motion import minimum_jerk
from srl.sim.wearer.reaching import Reaching
from srl.sim.wearer.showing import LOWERED, showing

Script = Literal["t-pose", "still", "walk", "reach", "show"]
_START: Final = 2.0  # s, from standing to walking


class Motion(Protocol):
    """See the module's text. Attributes: `offsets` (59, 3), m, of the person who moves."""

    offsets: Array

    def at(self, t: float) -> tuple[Array, Array]:
        """Hips (3,), m, and unit quaternions (59, 4), w x y z, at t seconds."""
        ...


class Recorded:
    """A file of the suit's software, BVH or MVNX; each frame is played at its time, and the last pose is held.

    With `loop` it goes back again. Bones keep the file's lengths at rest. The software stretches bones to keep the feet
    on the floor; these changes of length are ignored.
    """

    def __init__(self, path: Path, skeleton: Skeleton, scale: float, loop: bool) -> None:
        """
        Raises:
            RecordingError: it can't be read, or is of another skeleton.
        """
        motion = suit_motion.read(path, skeleton)
        self.offsets = motion.offsets * scale
        self._hips = motion.translation[:, 0] * scale
        self._rotations, self._times, self._loop = motion.rotation, motion.times, loop
        self.duration = float(motion.times[-1])

    def at(self, t: float) -> tuple[Array, Array]:
        if self._loop:
            t %= 2.0 * self.duration
            t = min(t, 2.0 * self.duration - t)
        t = min(max(t, 0.0), self.duration)
        i = min(int(np.searchsorted(self._times, t, side="right")) - 1, len(self._times) - 2)
        s = (t - self._times[i]) / (self._times[i + 1] - self._times[i])
        hips = self._hips[i] + s * (self._hips[i + 1] - self._hips[i])
        q = self._rotations[i] + s * (self._rotations[i + 1] - self._rotations[i])
        return hips, q / np.sqrt(np.einsum("ij,ij->i", q, q))[:, None]


class Scripted:
    """Standing in the T-pose or at ease, walking in a circle, reaching with the arms in turn, or showing a task."""

    def __init__(self, script: Script, skeleton: Skeleton, scale: float, seed: int, name: str) -> None:
        self.offsets = skeleton.offsets * scale
        self._script, self._scale = script, scale
        self._index = {joint: i for i, joint in enumerate(skeleton.names)}
        self._key = [seed, zlib.crc32(name.encode())]
        self._phases = np.random.default_rng(self._key).uniform(0.0, 2.0 * np.pi, 4)
        self._quaternions = EulerQuaternions("YXZ", JOINTS)
        self._reaching = Reaching(self._key, self._index)
        self._ease = at_ease(self._index)

    def at(self, t: float) -> tuple[Array, Array]:
        hips, angles = self.offsets[0].copy(), np.zeros((JOINTS, 3))
        if self._script != "t-pose":
            angles += self._ease
            self._sway(max(t, 0.0), hips, angles)
        if self._script == "walk":
            self._walk(max(t, 0.0), hips, angles)
        elif self._script == "reach":
            angles += self._reaching.at(max(t, 0.0))
        elif self._script == "show":
            angles += showing(t, self._index, JOINTS) if t < LOWERED else self._reaching.at(t - LOWERED)
        rotations = np.empty((JOINTS, 4))
        self._quaternions.fill(np.deg2rad(angles), rotations)
        return hips, rotations

    def _sway(self, t: float, hips: Array, angles: Array) -> None:
        """Adds breathing, and the slow sway of a standing person."""
        p = self._phases
        hips[0] += 0.006 * np.sin(1.6 * t + p[0])
        hips[2] += 0.008 * np.sin(1.1 * t + p[1])
        angles[self._index["Spine1"], 1] += 0.8 * np.sin(1.5 * t + p[2])
        angles[self._index["Head"], 0] += 3.0 * np.sin(0.5 * t + p[3])

    def _walk(self, t: float, hips: Array, angles: Array) -> None:
        gain = float(minimum_jerk(np.array(min(t / _START, 1.0))))
        add_gait(hips, angles, self._index, walked(t, _START), gain, self._scale)
