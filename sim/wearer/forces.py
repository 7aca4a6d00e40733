"""Recorded forces of hands, from people who moved a robot by its tool or handed over an object."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import ProfilePath
from srl.runtime.contracts.signals import Array
from srl.sim.wearer import npz
from srl.sim.wearer.checks import check_samples
from srl.sim.wearer.mat5 import read_mat5
from srl.sim.wearer.motion import Curve
from srl.sim.wearer.tables import read_rows, time_column

_COLUMNS: Final = ("fx", "fy", "fz", "tx", "ty", "tz")
_TIMES: Final = ("time", "t", "time_s")
_HANDOVER_RATE: Final = 120.0  # Hz, of the wrenches in the public handover recordings, which contain no time


class ForceRecording(BaseModel):
    """Which forces to replay, and how."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    file: ProfilePath = Field(description=".csv, .npz or .mat")
    number: int = Field(default=0, ge=0, description="of the recording in a file that has several")
    rate: float | None = Field(default=None, gt=0, description="Hz, of a file without times; null: see the page")
    start: float = Field(default=0.0, ge=0, description="s of world time at which it begins")
    speed: float = Field(default=1.0, gt=0, description="1: at the recorded pace")
    scale: float = Field(default=1.0, description="of forces and torques; -1 turns a reaction into an action")
    unbiased: bool = Field(default=False, description="take the mean away")
    frame: Literal["world", "hand"] = Field(default="world", description="whose axes the forces are in")


class Forces:
    """Wrenches over time: monotone cubic interpolation between samples, zero before and after.

    Attributes:
        frame: the frame whose axes are used.
        duration: world time at which they end, s.
    """

    def __init__(self, time: Array, wrench: Array, options: ForceRecording) -> None:
        """Args: time (n,), s, rising; wrench (n, 6), N, N m."""
        if options.unbiased:
            wrench = wrench - wrench.mean(axis=0)
        self.frame = options.frame
        self._curve = Curve(time - time[0], options.scale * wrench)
        self._start, self._speed = options.start, options.speed
        self.duration = options.start + float(time[-1] - time[0]) / options.speed

    def at(self, t: float) -> list[float]:
        """The wrench (6,) N, N m, at t seconds of world time."""
        if not self._start <= t <= self.duration:
            return [0.0] * 6
        out: list[float] = self._curve.at_one((t - self._start) * self._speed).tolist()
        return out


def load_forces(options: ForceRecording, place: str) -> Forces:
    """Reads the file.

    Raises:
        RecordingError: with file and column, what was expected, and the remedy.
    """
    path = options.file
    if not path.exists():
        raise RecordingError(str(path), "there is no such file", f"Check '{place}.file'")
    readers = {".csv": _csv, ".npz": _npz, ".mat": _mat}
    if (read := readers.get(path.suffix.lower())) is None:
        raise RecordingError(
            str(path), f"'{path.suffix}' is no kind of force recording", "Give a .csv, .npz or .mat file"
        )
    parts = read(path, options.rate)
    if options.number >= len(parts):
        raise RecordingError(
            str(path), f"it has no recording {options.number}", f"It has {len(parts)}, numbered from 0"
        )
    time, wrench = parts[options.number]
    check_samples(path, time, wrench, list(_COLUMNS), 1)
    return Forces(time, wrench, options)


def _csv(path: Path, rate: float | None) -> list[tuple[Array, Array]]:
    """Reads columns Fx, Fy, Fz and, if present, Tx, Ty, Tz, in N and N m, and a time, s, if present."""
    header, rows, first = read_rows(path)
    names = [name.lower() for name in header]
    if any(axis not in names for axis in _COLUMNS[:3]):
        raise RecordingError(
            f"{path}, line 1", f"the header is '{', '.join(header)[:100]}'", "Name columns Fx, Fy, Fz and Tx, Ty, Tz"
        )
    try:
        table = np.array([[float(v or "nan") for v in row] for row in rows]).reshape(len(rows), len(header))
    except ValueError as error:
        raise RecordingError(f"{path}, from line {first} on", str(error), "Give numbers") from error
    wrench = np.zeros((len(rows), 6))
    for i, axis in enumerate(_COLUMNS):
        if axis in names:
            wrench[:, i] = table[:, names.index(axis)]
    own = time_column(f"{path}, line 1", names)
    time = np.arange(len(rows)) / (rate or _HANDOVER_RATE) if own is None else table[:, own[0]] * own[1]
    return [(time, wrench)]


def _npz(path: Path, rate: float | None) -> list[tuple[Array, Array]]:
    """Reads arrays `t` (n,), s, and `F` (n, 6), N and N m."""
    found = npz.arrays(path, ("t", "F"))
    if lacking := [name for name in ("t", "F") if name not in found or found[name].dtype.kind == "U"]:
        raise RecordingError(str(path), f"it has no numbers '{lacking[0]}'", "Give arrays t (n,) and F (n, 6)")
    time, wrench = found["t"], found["F"]
    if wrench.ndim != 2 or wrench.shape[1] != 6 or time.shape != wrench.shape[:1]:
        raise RecordingError(str(path), f"t is {time.shape}, F is {wrench.shape}", "Give arrays t (n,) and F (n, 6)")
    return [(time, wrench)]


def _mat(path: Path, rate: float | None) -> list[tuple[Array, Array]]:
    """Reads a struct array with `F` (3, n) or (6, n), N, and, for the time, `pos` (3, n), m, and `vel` (3, n), m/s.

    If no rate is given, it is the one at which the velocities agree with the positions.
    """
    found = [rows for rows in read_mat5(path).values() if isinstance(rows, list) and rows and "F" in rows[0]]
    if not found:
        raise RecordingError(
            str(path), "no struct array in it has a field 'F'", "Give fields F, pos and vel, a column a sample"
        )
    out = []
    for row in found[0]:
        force = row["F"]
        if not isinstance(force, np.ndarray) or force.ndim != 2 or force.shape[0] not in (3, 6):
            raise RecordingError(str(path), "a field 'F' isn't (3, n) or (6, n)", "Give a column a sample")
        wrench = np.zeros((force.shape[1], 6))
        wrench[:, : force.shape[0]] = force.T
        out.append((np.arange(len(wrench)) / (rate or _rate(path, row)), wrench))
    return out


def _rate(path: Path, row: dict[str, Array]) -> float:
    try:
        moved, vel = np.diff(row["pos"], axis=1), row["vel"]
        mean = (vel[:, 1:] + vel[:, :-1]) / 2
        step = float((moved * mean).sum() / (mean * mean).sum())
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise RecordingError(str(path), "its rate can't be found from 'pos' and 'vel'", "Give 'rate'") from error
    if not 1e-4 < step < 1.0:
        raise RecordingError(str(path), f"'pos' and 'vel' give {step:.3g} s a sample", "Give 'rate'")
    return 1.0 / step
