"""Motion of an object in front of the cameras: still, in a circle, in six sines, or as recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Protocol, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import ProfilePath
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import POINT
from srl.sim.wearer.checks import check_samples
from srl.sim.wearer.motion import Curve
from srl.sim.wearer.tables import read_rows, time_column

_RATIOS: Final = np.array([1.0, 0.7, 1.3, 0.6, 0.9, 1.1])  # of the six frequencies, so the path doesn't repeat soon
_POSITION: Final = ("x", "y", "z")
_ORIENTATIONS: Final = (("qw", "qx", "qy", "qz"), ("q3", "q0", "q1", "q2"))  # numbered names have the scalar last


class MotionConfig(BaseModel):
    """`motion` of a mocap-body. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["still", "circle", "sine", "recording"] = "still"
    period: float = Field(default=4.0, gt=0.1, description="s: of a turn of the circle, of the first sine")
    radius: float = Field(default=0.1, ge=0, description="m: of the circle, in the base's x-y plane")
    amplitude: Annotated[tuple[Finite, ...], PerElement((*POINT, "rx", "ry", "rz"), ordered=False)] = Field(
        default=(0.1, 0.1, 0.1, 0.3, 0.3, 0.3), description="of the sines: m along x, y, z; rad about them (rx, ry, rz)"
    )
    file: ProfilePath | None = Field(
        default=None, description="CSV with columns x, y, z (m), qw, qx, qy, qz or q0..q3 (scalar last), maybe time (s)"
    )
    rate: float = Field(default=100.0, gt=0, description="Hz, of a recording without a column 'time'")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.kind == "recording") != (self.file is not None):
            raise ValueError("'kind: recording' needs 'file', and 'file' needs 'kind: recording'")
        return self


class Motion(Protocol):
    """A pose as a function of time, relative to the base."""

    def at(self, t: float) -> Array:
        """(7,): x, y, z (m), w, x, y, z at t seconds since the world's start."""
        ...


def make_motion(config: MotionConfig) -> Motion:
    """Creates the motion that a profile sets.

    Raises:
        RecordingError: the recording can't be read.
    """
    if config.file is not None:
        return Recorded(*read(config.file, config.rate))
    return Scripted(config)


class Scripted:
    """See the module's text; starts at the base, at rest for `still`, otherwise in motion."""

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._rates = 2.0 * np.pi / config.period * _RATIOS
        self._amplitude = np.array(config.amplitude)

    def at(self, t: float) -> Array:
        pose = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        if self._config.kind == "circle":
            angle = self._rates[0] * t
            pose[:2] = self._config.radius * np.array([np.cos(angle) - 1.0, np.sin(angle)])
        elif self._config.kind == "sine":
            offset = self._amplitude * np.sin(self._rates * t)
            pose[:3] = offset[:3]
            half = 0.5 * float(np.linalg.norm(offset[3:]))
            pose[3] = np.cos(half)
            pose[4:] = 0.5 * np.sinc(half / np.pi) * offset[3:]
        return pose


class Recorded:
    """Plays a recording forward and backward, so that it never jumps; positions are relative to the first one."""

    def __init__(self, time: Array, poses: Array) -> None:
        """Args: time (n,), s, increasing; poses (n, 7)."""
        poses = poses.copy()
        for row in range(1, len(poses)):
            if poses[row, 3:] @ poses[row - 1, 3:] < 0.0:
                poses[row, 3:] *= -1.0
        self._first = poses[0].copy()
        self._curve = Curve(time, poses)
        self._start, self._span = float(time[0]), float(time[-1] - time[0])

    def at(self, t: float) -> Array:
        t %= 2.0 * self._span
        pose = self._curve.at_one(self._start + min(t, 2.0 * self._span - t))
        pose[3:] /= np.linalg.norm(pose[3:])
        pose[:3] -= self._first[:3]
        return pose


def read(path: Path, rate: float) -> tuple[Array, Array]:
    """Reads a recording: time (n,), s, and poses (n, 7).

    Raises:
        RecordingError: with the file, what was expected there, and the remedy.
    """
    try:
        names, rows, _ = read_rows(path)
        values = np.array([[float(cell) for cell in row] for row in rows]).reshape(len(rows), len(names))
    except ValueError as error:
        raise RecordingError(str(path), f"it isn't a table of numbers: {error}", "Give a CSV file") from None
    wanted = next((q for q in _ORIENTATIONS if set(q) <= set(names)), None)
    if wanted is None or not set(_POSITION) <= set(names) or values.shape[1:] != (len(names),):
        raise RecordingError(
            str(path),
            f"its columns are {', '.join(names)[:80]}",
            "Expected x, y, z and qw, qx, qy, qz (or q0 to q3, the scalar last), and maybe time",
        )
    columns = [names.index(name) for name in (*_POSITION, *wanted)]
    own = time_column(str(path), names)
    time = np.arange(len(values)) / rate if own is None else values[:, own[0]] * own[1]
    poses = np.ascontiguousarray(values[:, columns])
    check_samples(path, time, poses, [names[c] for c in columns], first_line=2)
    lengths = np.linalg.norm(poses[:, 3:], axis=1)
    if (abs(lengths - 1.0) > 0.05).any():
        row = int(np.argmax(abs(lengths - 1.0) > 0.05))
        raise RecordingError(f"{path}, line {row + 2}", "the orientation is no unit quaternion", "Cut the line out")
    return np.ascontiguousarray(time), poses
