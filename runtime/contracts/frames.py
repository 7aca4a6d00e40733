"""The tree of coordinate frames: mounts, mocap origin, chest, hand, tool, base.

A profile's `frames:` is the one tree of fixed and measured transforms. Laws and simulated parts are given what they
need from it. A device's own frame has the device's name; `DEVICE/LINK` (arm/flange) is a link of it that moves with its
joints, and `PART/BODY` a body of a simulated part: fixed frames may hang on both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.rotation import Pose, Quaternion, Vector
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import PLANAR

IDENTITY: Final[Pose] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
FASTEST: Final = 10.0
"""m/s: what moves faster has been mistaken for something else, or measured in another frame."""
NOWHERE: Final[Pose] = (nan, nan, nan, nan, nan, nan, nan)


class Placement(Options):
    """A pose in a profile: `position`, and either `quaternion` or `rpy`. The only notation for it."""

    gone: ClassVar[Mapping[str, str]] = {
        "xyz": "it is called 'position'",
        "orientation": "it is called 'quaternion'",
        "euler": "write `rpy`, rad",
    }

    position: Vector = Field((0.0, 0.0, 0.0), description="m")
    quaternion: Quaternion | None = Field(None, description="w x y z; scaled to length 1")
    rpy: Vector | None = Field(None, description="rad, about the fixed axes x, then y, then z")

    @model_validator(mode="after")
    def _one_rotation(self) -> Placement:
        if not all(map(isfinite, (*self.position, *(self.quaternion or ()), *(self.rpy or ())))):
            raise ValueError("a pose needs finite numbers")
        if self.quaternion is not None and self.rpy is not None:
            raise ValueError("give the rotation once: either `quaternion` or `rpy`")
        if self.quaternion is not None and not 1e-6 < sum(q * q for q in self.quaternion) < 1e6:
            raise ValueError("a quaternion of length zero is no rotation; without one it is 1, 0, 0, 0")
        return self

    def placed(self) -> Pose:
        """x, y, z (m), w, x, y, z."""
        turn = rotation.from_rpy(*self.rpy) if self.rpy is not None else (1.0, 0.0, 0.0, 0.0)
        return (*self.position, *(turn if self.quaternion is None else rotation.normalised(self.quaternion)))


def _named(given: Any) -> Any:
    """A file's path, which is read where the tree is made: a profile whose frame isn't calibrated yet can be read."""
    if not (isinstance(given, str | KeptFile) and given):
        raise ValueError("must be the path of a file")
    return given


class FrameEntry(Placement):
    """One frame of the profile, `frames.<name>`: fixed in its parent, or measured by a signal."""

    parent: str | None = Field(None, description="a frame, a device's link, a simulated part's body; null for a root")
    pose: str | None = Field(
        None,
        description="signal that measures it: a pose, or x, y, yaw of a mobile base; position and rotation come first",
    )
    calibration: Annotated[Any, PlainValidator(_named), WithJsonSchema({"type": "string", "format": "path"})] = Field(
        None, description="file of `srl calibrate PROFILE frames` that says where it is; then no position or rotation"
    )
    speed: float = Field(
        FASTEST, gt=0, description="m/s: a measured frame that moves faster is lost; .inf: it may jump"
    )

    @model_validator(mode="after")
    def _one_place(self) -> FrameEntry:
        if self.calibration is None:
            return self
        if given := {"position", "quaternion", "rpy", "pose"} & self.model_fields_set:
            raise ValueError(f"`calibration` says where it is: leave `{min(given)}` out, or `calibration`")
        if self.parent is None:
            raise ValueError("`calibration` says where it is in its parent: name it, `parent: FRAME`")
        return self

    @classmethod
    def recorded(cls, values: Mapping[str, Any]) -> FrameEntry:
        """The frame of a recording's metadata; older recordings say `xyz` and `rpy`."""
        given = {key: value for key, value in values.items() if value is not None}
        return cls.model_validate({"position" if key == "xyz" else key: value for key, value in given.items()})


class FrameError(OptionError):
    """A transform that the tree can't give."""


@dataclass(frozen=True)
class Path:
    """The way from one frame to another.

    Attributes:
        target, source: the frames; its pose is that of `source` in `target`.
        up, down: frames from `source`, or from `target`, to the one that both hang on; that one isn't in them.
    """

    target: str
    source: str
    up: tuple[str, ...]
    down: tuple[str, ...]


class Frames:
    """A checked tree of frames. A name without an entry is a root, if it is a device or a link or body of one."""

    def __init__(self, entries: Mapping[str, FrameEntry], known: Iterable[str] = ()) -> None:
        """Args:
            entries: by name.
            known: devices and simulated parts, whose frames and links may be parents.
        Raises:
            FrameError: an unknown parent, or a circle.
        """
        self.entries, self.known = dict(entries), frozenset(known)
        for name, entry in entries.items():
            if "/" in name:
                raise FrameError(f"'{name}' is a link's name", "Name the frame without a slash")
            if entry.parent is not None and not self.has(entry.parent):
                remedy = nearest(entry.parent.partition("/")[0], [*entries, *self.known])
                raise FrameError(f"frames.{name}.parent: no frame is called '{entry.parent}'", remedy)
        for name in entries:
            self.chain(name)

    def has(self, name: str) -> bool:
        """Whether this is a frame: one of the entries, a device or part, or (by its form) a link of one."""
        return name in self.entries or name.partition("/")[0] in self.known

    def chain(self, name: str) -> tuple[str, ...]:
        """The frames from this one to its root, both included. Raises FrameError for a circle."""
        seen = [name]
        while (entry := self.entries.get(seen[-1])) is not None and entry.parent is not None:
            if entry.parent in seen:
                circle = " -> ".join([*seen, entry.parent])
                raise FrameError(f"frames.{name}: the frames form a circle: {circle}", "Give one no parent")
            seen.append(entry.parent)
        return tuple(seen)

    def path(self, target: str, source: str) -> Path:
        """The way from `source` to `target`.

        Raises:
            FrameError: a frame isn't known, or nothing connects them.
        """
        for name in (target, source):
            if not self.has(name):
                raise FrameError(f"no frame is called '{name}'", nearest(name, [*self.entries, *self.known]))
        up, down = self.chain(source), self.chain(target)
        if up[-1] != down[-1]:
            raise self._apart(target, source, up[-1], down[-1])
        common = next(name for name in up if name in down)
        return Path(target, source, up[: up.index(common)], down[: down.index(common)])

    def measuring(self, path: Path) -> list[str]:
        """The frames on a path whose poses are measured."""
        return [n for n in (*path.up, *path.down) if self.entries[n].pose is not None]

    def fixed(self, path: Path) -> Pose:
        """The pose of a path whose measured frames, if there are any, stand where they are measured as zero."""
        return rotation.composed(rotation.inverted(self._down(path.down)), self._down(path.up))

    def _down(self, names: Iterable[str]) -> Pose:
        made = IDENTITY
        for name in names:
            made = rotation.composed(self.entries[name].placed(), made)
        return made

    def _apart(self, target: str, source: str, *roots: str) -> FrameError:
        problem = f"nothing connects '{source}' with '{target}'"
        for root in roots:
            device, slash, _ = root.partition("/")
            if slash and self.chain(device)[-1] in roots:
                return FrameError(
                    f"{problem}: '{root}' moves with '{device}' or its joints, and no fixed frame says where it is",
                    f"Hang it on '{device}'; of an arm's flange the law `tool-pose` gives the pose",
                )
        lone = next((r for r in roots if r not in self.entries), None)
        if lone is not None:
            return FrameError(problem, f"Say under `frames:` where it is: {lone}: {{parent: ..., position: ...}}")
        return FrameError(problem, f"Their roots are '{roots[0]}' and '{roots[1]}': give one a parent")


class Measured:
    """A transform through measured frames, computed anew each cycle.

    Attributes:
        pose: (7,), the pose of the path's source in its target. While a measured pose is none it stays as it was; NaN
            if there was none yet. That one is lost is decided elsewhere (`srl.runtime.loop.faults`).
    """

    def __init__(self, frames: Frames, path: Path, signals: Mapping[str, Array]) -> None:
        """`signals`: the arrays of the signals that measure frames, (7,) or (3,), by name."""
        self.pose: Array = np.full(7, nan)
        self._up, self._down = (self._steps(frames, names, signals) for names in (path.up, path.down))

    @staticmethod
    def _steps(frames: Frames, names: Iterable[str], signals: Mapping[str, Array]) -> list[tuple[Pose, Array | None]]:
        entries = [frames.entries[name] for name in names]
        return [(e.placed(), None if e.pose is None else signals[e.pose]) for e in entries]

    def update(self) -> None:
        """Computes `pose` from the present measurements."""
        up, down = _composed(self._up), _composed(self._down)
        pose = rotation.composed(rotation.inverted(down), up)
        if isfinite(sum(pose)):
            self.pose[:] = pose


def _composed(steps: list[tuple[Pose, Array | None]]) -> Pose:
    made = IDENTITY
    for fixed, signal in steps:
        if signal is not None:
            made = rotation.composed(as_pose(signal), made)
        made = rotation.composed(fixed, made)
    return made


def as_pose(measured: Array) -> Pose:
    """A measured pose (7,), or planar pose (3,), with a unit quaternion; NaN where the quaternion is none."""
    values = measured.tolist()
    if len(values) == len(PLANAR):
        x, y, yaw = values
        return (x, y, 0.0, *rotation.exp(0.0, 0.0, yaw)) if isfinite(yaw) else NOWHERE
    x, y, z, *q = values
    return (x, y, z, *rotation.normalised((q[0], q[1], q[2], q[3]))) if is_pose(measured) else NOWHERE


def is_pose(measured: Array) -> bool:
    """Whether a measured pose (7,) has a rotation: a device that has lost sight gives a quaternion of zeros, or NaN."""
    return are_pose(measured.tolist())


def are_pose(values: list[float]) -> bool:
    """`is_pose` of the values as a list."""
    if len(values) == len(PLANAR):
        return isfinite(values[0] + values[1] + values[2])
    x, y, z, w, a, b, c = values
    return 0.95 < w * w + a * a + b * b + c * c < 1.05 and isfinite(x + y + z)
