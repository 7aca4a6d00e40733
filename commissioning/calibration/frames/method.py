"""How a frame is calibrated: where it is in its parent, from points or poses that are measured in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final, get_args

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.frames import report as frame_report
from srl.commissioning.calibration.frames.fit import Mount, MountError, Thresholds, fit, refusals
from srl.commissioning.calibration.frames.procedure import Procedure
from srl.commissioning.calibration.frames.report import Result
from srl.commissioning.calibration.frames.samples import FrameMarksConfig, Plan, Samples, held, pairs
from srl.commissioning.calibration.marks import Indices, joined
from srl.commissioning.calibration.method import FittedMethod, Say, file_of
from srl.commissioning.calibration.pose_signals import pose_signals
from srl.commissioning.calibration.profile_subset import subset_of_devices
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError, nearest
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.mount_record import FORMAT, FrameRecord
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

_PEOPLE: Final = ("person", "hands")  # parts of whoever would lead another thing meanwhile


class Between(Options):
    """Which frame, and what measures it."""

    frame: str | None = None
    parent_signal: str | None = None
    frame_signal: str | None = None


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read: the poses in `parent` and frame (`own`; None: known points), each (7,)."""

    law, config, unknown = "frame-marks", FrameMarksConfig, "which samples belong together"
    parent: Indices
    own: Indices | None

    @classmethod
    def places(cls, layout: Layout, options: FrameMarksConfig, place: str) -> tuple[Any, ...]:
        own = None if options.frame_signal is None else words(layout, [options.frame_signal], place)
        return words(layout, [options.parent_signal], place), own

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        own = np.tile(IDENTITY, (len(floats), 1)) if self.own is None else _seen(floats[:, self.own])
        return Samples(times, _seen(floats[:, self.parent]), own, marks)


class FrameMethod(FittedMethod[ChannelMap, Mount]):
    """See the module's docstring."""

    name, record_type, error, channels = "frames", FrameRecord, MountError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds, "between": Between}
    fixed = ("plan",)
    personal = False
    thing = "points or poses"
    report: ClassVar[ModuleType] = frame_report

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        frame = _frame(request, checked, source)
        given = checked.frames[frame].calibration
        return given.path if isinstance(given, KeptFile) else file_of(source, given, f"frames.{frame}.calibration")

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        between = self._settings["between"]
        self._frame = _frame(request, checked, source)
        parent = checked.frames[self._frame].parent
        assert parent is not None  # a frame with `calibration` has one
        self._parent = parent
        poses = pose_signals(checked, source)
        self._signals = [_signal(poses, parent, between.parent_signal, "parent_signal")]
        if not self._plan.known:
            self._signals.append(_signal(poses, self._frame, between.frame_signal, "frame_signal"))
        elif between.frame_signal is not None:
            raise RequestError("--option frame_signal", "with known points nothing measures them", "Leave it out")
        self._devices = {signal.partition(".")[0]: "" for signal in self._signals}
        self._devices = {device: checked.devices[device].driver for device in self._devices}
        given = {device: checked.devices[device].options.get("serial") for device in self._devices}
        self._serials = {device: str(serial) for device, serial in given.items() if serial is not None}

    def subset(self, person: str) -> tuple[Profile, Source]:
        return subset_of_devices(
            self.checked, self.source, set(self._devices), self._marks, self.request.sim, self._silent
        )  # fmt: skip

    def _marks(self, graph: Graph) -> dict[str, Any]:
        """The entry of the marks' law."""
        return self._entry(
            frame=self._frame, parent=self._parent, drivers=self._devices, serials=self._serials,
            parent_signal=self._signals[0], frame_signal=(*self._signals, None)[1],
        )  # fmt: skip

    def _silent(self, plain: dict[str, Any]) -> None:
        """Nothing is commanded: an arm is only read. What a calibration says isn't known yet."""
        arms = []
        for name, entry in plain["devices"].items():
            config = self.source.load("drivers", entry["driver"], f"devices.{name}.driver").Config
            interface = config.model_fields.get("interface")
            if interface is not None:
                if "none" not in get_args(interface.annotation):
                    problem = f"its driver '{entry['driver']}' can't be opened without taking the command over"
                    remedy = "Touch known points with what the parent's signal shows: --option known=x,y,z;..."
                    raise WiringError(self.source.place(f"devices.{name}"), problem, remedy)
                entry["interface"] = "none"
                arms.append(name)
        for name, frame in plain["frames"].items():
            if frame and frame.get("calibration") is not None:
                plain["frames"][name] = {"parent": frame["parent"]}
        if self.request.sim and plain.get("sim"):
            parts = plain["sim"].get("parts") or {}
            plain["sim"]["parts"] = {n: dict(part) for n, part in parts.items() if part.get("part") not in _PEOPLE}
            for name in arms:
                part = (plain["sim"].get("devices") or {}).get(name, {}).get("part", name)
                if part in plain["sim"]["parts"]:
                    plain["sim"]["parts"][part]["guided"] = True

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return one.options.model_copy(update={"thresholds": other.options.thresholds}) == other.options

    def _check(self, channel_map: ChannelMap, place: str) -> None:
        theirs, ours = channel_map.options, (self._frame, self._parent)
        if (theirs.frame, theirs.parent) != ours:
            problem = f"it is of '{theirs.frame}' in '{theirs.parent}', not of '{ours[0]}' in '{ours[1]}'"
            raise RequestError(place, problem, "Name a recording of this frame: --option frame=NAME")
        for device, driver in theirs.drivers.items():
            now = self.checked.devices[device].driver if device in self.checked.devices else None
            if now != driver:
                problem = f"it was measured with '{device}' by the driver '{driver}'; now it is {now or 'no device'}"
                raise RequestError(place, problem, "Name the profile with which it was recorded")
            was = theirs.serials.get(device)
            if was and (serial := self._serials.get(device, was)) != was:
                problem = f"it was measured with '{device}' of serial {was}; now it is {serial}"
                raise RequestError(place, problem, "Name the profile with which it was recorded")

    def procedure(self, before: Sequence[Any]) -> Procedure:
        done = None
        if before:
            done = {n: poses[0] for n, poses in held(joined(before), self._plan, self._thresholds)[0].items()}
        return Procedure(self._plan, self._thresholds, done)

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Mount, tuple[MountError, ...]]:
        plan, thresholds = channel_map.options.plan, channel_map.options.thresholds
        found, noise = held(samples, plan, thresholds)
        mount = fit(plan.what, *pairs(found, plan), noise, thresholds)
        return mount, refusals(mount, thresholds)

    def _content(self, result: Result[Mount]) -> dict[str, Any]:
        mount, options = result.found, result.options
        return {
            "format": FORMAT, "frame": options.frame, "parent": options.parent, "drivers": options.drivers,
            "serials": options.serials,
            "signals": [signal for signal in (options.parent_signal, options.frame_signal) if signal],
            "what": mount.what, "count": len(mount.numbers), "pose": _pose(mount.pose),
            "body": None if mount.body is None else _pose(mount.body),
            "left": (float(mount.left.max()), float(mount.askew.max())), "uncertain": mount.uncertain,
        }  # fmt: skip


def _seen(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (T, 7), NaN where there is no rotation: who has lost sight gives a quaternion of zeros, or NaN."""
    length = np.sum(poses[:, 3:] ** 2, axis=1)
    return np.where(((length > 0.95) & (length < 1.05))[:, None], poses, np.nan)


def _pose(pose: NDArray[np.float64]) -> dict[str, list[float]]:
    return {"position": pose[:3].round(7).tolist(), "quaternion": pose[3:].round(9).tolist()}


def _frame(request: CalibrationRequest, checked: Profile, source: Source) -> str:
    """The frame that is meant. Raises RequestError, ProfileError."""
    calibrated = [name for name, entry in checked.frames.items() if entry.calibration is not None]
    for text in request.option:
        key, _, value = text.partition("=")
        if key == "frame":
            if value not in calibrated:
                problem = f"frames.{value} has no `calibration:`" if value in checked.frames else f"no frame '{value}'"
                raise RequestError("--option frame", problem, nearest(value, calibrated))
            return value
    if not calibrated:
        remedy = "Write what is looked for: frames: {arm: {parent: room, calibration: arm.json}}"
        raise ProfileError(source.place("frames"), "no frame has `calibration:`", remedy)
    if len(calibrated) > 1:
        remedy = f"Name one: --option frame={calibrated[0]}"
        raise RequestError("--option frame", f"{len(calibrated)} frames have `calibration:`", remedy)
    return calibrated[0]


def _signal(poses: dict[str, str | None], frame: str, given: str | None, option: str) -> str:
    """The pose that is measured in a frame. Raises RequestError."""
    fitting = [signal for signal, into in poses.items() if into == frame]
    if given is not None:
        if given not in fitting:
            into = (
                f"it is in {poses[given] or 'no frame'}, not in '{frame}'" if given in poses else "no pose of a device"
            )
            raise RequestError(f"--option {option}", f"'{given}': {into}", nearest(given, fitting))
        return given
    if len(fitting) != 1:
        problem = f"{len(fitting)} devices' poses are measured in '{frame}'"
        remedy = f"Name one: {option}={fitting[0]}" if fitting else f"Give the device that sees it `frame: {frame}`"
        raise RequestError(f"--option {option}", problem, remedy)
    return fitting[0]
