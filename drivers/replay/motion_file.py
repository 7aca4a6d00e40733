"""Motion files of capture software as a device: BVH, MVNX, C3D. The states are those of the system's own driver."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from srl.drivers.capture import c3d, view
from srl.drivers.capture.config import CaptureConfig
from srl.drivers.noitom.config import signals as suit_signals
from srl.drivers.noitom.skeleton import Kind, Skeleton
from srl.drivers.replay import suit_motion
from srl.drivers.replay.config import ANY, ReplayConfig, checked
from srl.drivers.replay.track import Samples
from srl.drivers.xsens_mvn import mvnx
from srl.drivers.xsens_mvn.config import MvnConfig, slug
from srl.drivers.xsens_mvn.config import signals as mvn_signals
from srl.drivers.xsens_mvn.protocol import SEGMENTS
from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import WRENCH

Values = list[Array]


def samples(config: ReplayConfig) -> Samples:
    """A file's frames as a device's samples, each as old as it comes: a file doesn't say its system's delay.

    Raises:
        RecordingError: the file can't be read, or lacks what the options name.
        HostError: a C3D file's reader isn't installed.
    """
    path = config.recording
    times, signals, values, shown = _READ[path.suffix.lower()](path, config)
    own = shown & (times >= config.start)
    if not own.any():
        problem = f"it shows nothing of what is wanted after {config.start:g} s of {times[-1]:.1f} s"
        raise RecordingError(str(path), problem, "Choose another `start`, or fewer under `required`")
    at = np.round(times[own] * 1e9).astype(np.int64)
    return Samples(signals, at - at[0], np.zeros_like(at), [value[own] for value in values])


def recorded(path: Path) -> int:
    """ns of Unix time at the first frame: what the file says, else when the file was last changed."""
    if path.suffix.lower() == ".mvnx" and (ms := _mvnx(path, _changed(path)).recorded) is not None:
        return ms * 1_000_000
    return _changed(path)


Read = tuple[Array, tuple[Signal, ...], Values, NDArray[np.bool_]]


@lru_cache(maxsize=4)
def _mvnx(path: Path, changed: int) -> mvnx.Mvnx:
    return mvnx.read(path)


@lru_cache(maxsize=4)
def _c3d(path: Path, up: Literal["y", "z"] | None, changed: int) -> c3d.C3d:
    return c3d.read(path, up)


@lru_cache(maxsize=4)
def _suit(path: Path, kind: Kind, changed: int) -> suit_motion.SuitMotion:
    return suit_motion.read(path, Skeleton(kind))


def _changed(path: Path) -> int:
    """When the file changed, so that a new one is read anew."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0  # who reads it says why it can't be read


def _as_suit(path: Path, config: ReplayConfig) -> Read:
    kind: Kind = config.skeleton or "axis-neuron"
    motion = _suit(path, kind, _changed(path))
    shown = np.ones(len(motion.times), np.bool_)
    return motion.times, suit_signals(Skeleton(kind)), [motion.rotation, motion.translation], shown


def _as_mvn(path: Path, config: ReplayConfig) -> Read:
    if config.skeleton is not None:
        return _as_suit(path, config)
    file = _mvnx(path, _changed(path))
    options = checked(config)
    assert isinstance(options, MvnConfig)
    if not config.segments:  # all that the file has of MVN's body
        there = {slug(name): name for name in SEGMENTS if name in file.segments}
        options = options.model_copy(update={"segments": there})
    for name in options.segments.values():
        if name not in file.segments:
            raise RecordingError(str(path), f"it has no segment '{name}'", nearest(name, file.segments))
    at = [file.segments.index(name) for name in options.segments.values()]
    pose = np.concatenate([file.position[:, at], file.orientation[:, at]], axis=2)
    turn = np.ascontiguousarray(pose[..., 3:])
    suit_motion.steady(turn)
    pose[..., 3:] = turn
    values: Values = [pose, np.ones(pose.shape[:2]), *(pose[:, i] for i in range(len(at)))]
    if options.joints:
        if file.joint_angles is None:
            raise RecordingError(str(path), "it has no joint angles", "Tick them in MVN's export")
        for name in options.joints:
            if name not in file.joints:
                raise RecordingError(str(path), f"it has no joint '{name}'", nearest(name, filter(None, file.joints)))
        values.append(file.joint_angles[:, [file.joints.index(name) for name in options.joints]])
    if options.centre_of_mass:
        if file.centre_of_mass is None:
            raise RecordingError(str(path), "it has no centre of mass", "Tick it in MVN's export")
        values.append(file.centre_of_mass)
    return file.times, mvn_signals(options), values, np.ones(len(file.times), np.bool_)


def _as_markers(path: Path, config: ReplayConfig) -> Read:
    file = _c3d(path, config.up, _changed(path))
    options = checked(config) or CaptureConfig(markers=_named(path, file), required=config.required, frame=config.frame)
    rows = {name: file.index(target.removeprefix(f"{ANY}/")) for name, target in options.markers.items()}
    for name, row in rows.items():
        if row < 0:
            target = options.markers[name].removeprefix(f"{ANY}/")
            known = [label.replace(":", "/") for label in file.labels]
            raise RecordingError(str(path), f"it has no marker '{target}', or several", nearest(target, known))
    points = file.points[:, list(rows.values())]
    seen = np.asarray(np.isfinite(points).all(axis=2))
    need = [list(rows).index(name) for name in options.required]
    shown = np.asarray(seen[:, need].all(axis=1) if need else seen.any(axis=1))
    values: Values = [_held(points, seen), seen.astype(float)]
    signals = view.signals(options)
    if config.plates:
        if not file.plates.shape[1]:
            raise RecordingError(str(path), "it has no force plate that ezc3d knows", "Leave out `plates`")
        for i in range(file.plates.shape[1]):
            name = f"plate{i + 1}.wrench"
            signals += (Signal(name=name, shape=(6,), unit="N, N m", frame=config.frame, labels=WRENCH),)
            values.append(file.plates[:, i])
    return np.arange(len(points)) / file.rate, signals, values, shown


def _held(points: Array, seen: NDArray[np.bool_]) -> Array:
    """(n, k, 3): hidden markers stay where they were seen last, at the origin before, as the drivers give them."""
    last = np.maximum.accumulate(np.where(seen, np.arange(len(points))[:, None], -1), axis=0)
    held = np.take_along_axis(points, np.maximum(last, 0)[..., None], axis=0)
    return np.where((last >= 0)[..., None], held, 0.0)


def _named(path: Path, file: c3d.C3d) -> dict[str, str]:
    """All of a file's markers, as a profile may call them: by the marker's name, and the subject's if several have it.

    Raises RecordingError: two come to the same name.
    """
    markers = [label.rpartition(":")[2] for label in file.labels]
    found: dict[str, str] = {}
    for label, marker in zip(file.labels, markers, strict=True):
        own = label if markers.count(marker) > 1 else marker
        name = re.sub(r"[^a-z0-9_-]+", "_", own.lower())
        name = name if name[:1].isalpha() else f"m{name}"
        if name in found:
            problem = f"two of its markers would be called '{name}'"
            raise RecordingError(str(path), problem, "Name those that are wanted: markers: {NAME: SUBJECT/MARKER}")
        found[name] = label.replace(":", "/") if ":" in label else f"{ANY}/{label}"
    return found


_READ: Final[Mapping[str, Callable[[Path, Any], Read]]] = {".bvh": _as_suit, ".mvnx": _as_mvn, ".c3d": _as_markers}
