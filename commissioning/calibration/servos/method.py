"""How servos are calibrated: each joint is moved under a held key to known angles, which give trim and direction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.actuator_access import Drive
from srl.commissioning.calibration.calibrated_device import DeviceMethod
from srl.commissioning.calibration.keyed import Keyed
from srl.commissioning.calibration.marks import Indices, joined
from srl.commissioning.calibration.method import Say
from srl.commissioning.calibration.panel import PanelScreen
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.commissioning.calibration.screen import Screen
from srl.commissioning.calibration.servos import report as servo_report
from srl.commissioning.calibration.servos.fit import HornFit, ServoError, Thresholds, horn_fit, refusals
from srl.commissioning.calibration.servos.procedure import Procedure
from srl.commissioning.calibration.servos.report import Calibrated, Found, Result
from srl.commissioning.calibration.servos.samples import (
    FIRST,
    LEFT_OUT,
    Plan,
    Samples,
    ServoMarksConfig,
    angles,
    held,
    left_out,
)  # fmt: skip
from srl.commissioning.calibration.simulated_access import SimulatedDrive
from srl.commissioning.calibration.sources import RowSource
from srl.commissioning.jog.profile_subset import ProfileSubset
from srl.commissioning.jog.profile_subset import subset as jog_subset
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import RequestError, SrlError, WiringError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.servo_record import FORMAT, WHAT, Joint, ServoRecord
from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.part import parsed
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

_HAND: Final = "human-hand"


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of servos: `angles` (n,), of all joints."""

    law, config, unknown = "servo-marks", ServoMarksConfig, "which samples belong to which angle"
    angles: Indices

    @classmethod
    def places(cls, layout: Layout, options: ServoMarksConfig, place: str) -> tuple[Any, ...]:
        return (words(layout, [f"{options.signal}[{name}]" for name in options.joints], place),)

    @property
    def simulated(self) -> bool:
        """Whether the servos are simulated."""
        return self.options.device in self.layout.simulated

    def may_begin_again(self, row: NDArray[np.int64]) -> bool:
        """Never by itself: it could move."""
        return False

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        return Samples(times, floats[:, self.angles], marks)


class ServoMethod(DeviceMethod[ChannelMap, Calibrated]):
    """See the module's docstring."""

    name, record_type, error, channels = WHAT, ServoRecord, ServoError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    personal = False
    instructed = False
    thing = "joints"
    counted = range(FIRST + 1, LEFT_OUT)
    report: ClassVar[ModuleType] = servo_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        driver = self._driver()
        place = source.place(f"devices.{self._device}")
        if not driver.commands or driver.commands[0].kind is not Kind.POSITION:
            raise WiringError(place, "it takes no positions, so no joint goes to an angle", "Set mode: position")
        if driver.commands[0].slides:
            problem = f"'{driver.commands[0].slides[0]}' slides, and only joints that turn are calibrated"
            raise WiringError(place, problem, "Measure it, and set `zero` and `m_per_rad`")
        self._bare_driver, self._command = driver, driver.commands[0]
        try:
            for option in ("first", "second"):
                angles(getattr(self._plan, option), self._command.names, option)
        except ServoError as error:
            raise RequestError(error.place, error.problem, error.remedy) from None

    # -- the cut profile

    def _driver(self) -> Driver:
        """The device's driver, without its file and not opened. Raises ProfileError."""
        entry, path = self.checked.devices[self._device], f"devices.{self._device}"
        cls = self.source.load("drivers", entry.driver, f"{path}.driver")
        options = {key: value for key, value in entry.options.items() if key != self.option}
        made: Driver = cls(self._device, Builder(self.checked, self.source, None).options(cls.Config, options, path))
        return made

    @property
    def _joints(self) -> Mapping[str, Joint]:
        config: Any = self._bare_driver.config
        found: Mapping[str, Joint] = getattr(config, config.jointed)
        return found

    @property
    def _measures(self) -> bool:
        return self._command.feedback is not None

    def _without_file(self) -> tuple[Profile, Source]:
        """The whole profile as it is without a calibration: its bounds hold wherever the joints' zeros are.

        A device that doesn't measure begins with the pulses with which a run begins: with the file that is there now.
        """
        plain, _ = profile.tree(self.source.label, self.source.text, self.source.overrides, self.source.files)
        device = plain["devices"][self._device]
        device.pop(self.option, None)
        entries = device[self._bare_driver.config.jointed]  # type: ignore[attr-defined]
        if not self._measures:
            for name, angle in self._begins().items():
                entries[name]["home"] = angle
        for i, (name, joint) in enumerate(self._joints.items()):
            low, high = self._widened(i, joint.bounds.get("lower"), joint.bounds.get("upper"))
            entries[name] |= {key: value for key, value in (("lower", low), ("upper", high)) if key in joint.bounds}
        command = f"{self._device}.{self._command.name}"
        if (given := self.checked.guard.get(command)) is not None:
            place = self.source.place(f"guard.{command}")
            limits = given.to_limits(self._command.shape, place, self._command.labels, self._command.ordered)
            lows, highs = (None if b is None else b.tolist() for b in (limits.lower, limits.upper))
            for i, name in enumerate(self._joints):
                low, high = self._widened(i, lows and lows[i], highs and highs[i])
                for key, all_, value in (("lower", lows, low), ("upper", highs, high)):
                    if all_ is not None:
                        if not isinstance(plain["guard"][command].get(key), dict) or not i:
                            plain["guard"][command][key] = {}
                        plain["guard"][command][key][name] = value
        return parsed(plain, self.source, list(range(len(plain.get("controllers") or ()))))

    def _widened(self, i: int, low: float | None, high: float | None) -> tuple[float | None, float | None]:
        """Bounds of joint `i` (rad) in its entry's angle, wherever its zero is and whichever way it turns."""
        (mirror,), share = [list(self._joints.values())[i].mirror], 0.0 if self._measures else self._thresholds.share
        trim, (lowest, highest) = self._thresholds.trim, (self._reach[0][i], self._reach[1][i])
        far = [None if b is None else (b / (1.0 - share), b / (1.0 + share)) for b in (low, high)]
        down = None if far[0] is None else min(far[0]) - trim
        up = None if far[1] is None else max(far[1]) + trim
        ends = [None if down is None or up is None else min(down, mirror - up),
                None if down is None or up is None else max(up, mirror - down)]  # fmt: skip
        if self._measures:
            return ends[0], ends[1]
        return (None if ends[0] is None else max(ends[0], lowest)), (None if ends[1] is None else min(ends[1], highest))

    @cached_property
    def _reach(self) -> tuple[list[float], list[float]]:
        """rad, lowest and highest of the entries' angles that the servos may take, as far as the profile says."""
        limits, n = self._bare_driver.limits.get(self._command.name), len(self._joints)
        if self._measures or limits is None or limits.lower is None or limits.upper is None:
            return [-1e9] * n, [1e9] * n
        return limits.lower.tolist(), limits.upper.tolist()

    def _begins(self) -> dict[str, float]:
        """rad in the entry's angle, by joint: where a run begins now, with the file that the profile names."""
        found = {name: float(joint.home or 0.0) for name, joint in self._joints.items()}
        given = self.checked.devices[self._device].options.get(self.option)
        if given is None:
            return found
        entries = {name: joint.entry for name, joint in self._joints.items()}
        try:
            file = KeptFile.read(self.source.files.find(given))
            lines = servo_record.lines(file, self._driver_name, entries)
        except (SrlError, ValueError):
            return found  # no run begins with it
        for i, (name, joint) in enumerate(self._joints.items()):
            if (line := lines.get(name)) is not None:
                at = HornFit(line.trim, line.direction, line.scale, line.known, joint.mirror).entry(found[name])
                found[name] = min(max(at, self._reach[0][i]), self._reach[1][i])
        return found

    @property
    def _driver_name(self) -> str:
        return self.checked.devices[self._device].driver

    @cached_property
    def driven(self) -> ProfileSubset:
        """What `srl jog` would run of the profile, and the marks' law. Raises SrlError."""
        sim: list[str] | None = [] if self.request.sim else None
        made = jog_subset(*self._without_file(), self._device, self._plan.speed, sim, self.request.panel)
        plain, _ = profile.tree(made.source.label, made.source.text, made.source.overrides, made.source.files)
        plain["controllers"].append(self._marked())
        for part in ((plain.get("sim") or {}).get("parts") or {}).values():
            if part.get("part") == _HAND:  # it would play its own plan, and push the limb
                part["wearer"] = {"instructed": True}
        own, text = parsed(plain, made.source, [])
        graph = wiring.build(own, text, sim)
        (actuator,) = graph.actuators
        return replace(made, profile=own, source=text, graph=graph, actuator=actuator)

    def subset(self, person: str) -> tuple[Profile, Source]:
        return self.driven.profile, self.driven.source

    def _marked(self) -> dict[str, Any]:
        """The entry of the marks' law."""
        joints, command = self._joints, self._command
        feedback = f"{self._device}.{command.feedback}"
        homes = None if self._measures else [float(joint.home or 0.0) for joint in joints.values()]
        return self._entry(
            device=self._device, driver=self._driver_name,
            signal=feedback if self._measures else f"{self._device}.{command.name}.sent",
            joints={name: dict(joint.entry) for name, joint in joints.items()},
            mirror=[joint.mirror for joint in joints.values()], home=homes,
            lower=self._reach[0], upper=self._reach[1], measures=self._measures,
        )  # fmt: skip

    # -- the session

    def simulated(self, made: Profile, text: Source) -> RowSource:
        return SimulatedDrive(self.driven, self.channel_map, self.say, self.request.record)

    def live(self, text: Source, name: str, record: Path, screen: Screen) -> RowSource:
        if not isinstance(screen, PanelScreen):
            screen = Keyed(f"srl calibrate {self.request.profile} {WHAT}: {self._device}")
        driven = replace(self.driven, twins=self.request.twins)
        return Drive(driven, self.channel_map, name, record, self.request.view, screen, self.say)

    def _check(self, channel_map: ChannelMap, place: str) -> None:
        theirs = channel_map.options
        if (theirs.device, theirs.driver) != (self._device, self._driver_name):
            problem = f"it is of the device '{theirs.device}' ({theirs.driver})"
            raise RequestError(place, problem, f"Name a recording of '{self._device}' ({self._driver_name})")
        ours = {name: dict(joint.entry) for name, joint in self._joints.items()}
        if theirs.joints != ours:
            name = next(n for n in theirs.joints.keys() | ours if theirs.joints.get(n) != ours.get(n))
            problem = f"its joint '{name}' isn't as in the profile: other options, or none of this name"
            raise RequestError(place, problem, "Set the profile as it was, or calibrate from the beginning")

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return all(getattr(one.options, key) == getattr(other.options, key) for key in ("device", "driver", "joints"))

    def take(self, older: ChannelMap) -> ChannelMap:
        taken = super().take(older)
        homes = None if self._measures else [float(joint.home or 0.0) for joint in self._joints.values()]
        return replace(taken, options=taken.options.model_copy(update={"home": homes}))

    def procedure(self, before: Sequence[Any]) -> Procedure:
        options = ServoMarksConfig.model_validate({k: v for k, v in self._marked().items() if k not in ("use", "name")})
        if not before:
            return Procedure(options, None)
        samples, done = joined(before), dict[int, tuple[float, float] | None]()
        for i in range(len(options.joints)):
            if left_out(samples, i):
                done[i + 1] = None
            elif (both := self._places(samples, i)) is not None:
                done[i + 1] = both[0][0], both[1][0]
        return Procedure(options, done)

    def _places(self, samples: Samples, i: int) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Mean and deviation at both places of joint `i`; None: it wasn't held to the end at one. Raises ServoError."""
        one, two = (held(samples, i, second, self._plan, self._thresholds) for second in (False, True))
        return None if one is None or two is None else (one, two)

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Calibrated, tuple[ServoError, ...]]:
        options, limits = channel_map.options, self._thresholds
        names = tuple(options.joints)
        first = dict.fromkeys(names, 0.0) | angles(self._plan.first, names, "first")
        second = angles(self._plan.second, names, "second")
        found, left, refused = list[Found](), list[str](), list[ServoError]()
        for i, name in enumerate(names):
            place = f"joint {i + 1} ({name})"
            if left_out(samples, i):
                left.append(name)
                continue
            both = self._places(samples, i)
            if both is None:
                raise ServoError(place, "it wasn't held at both places to the end", f"Do it again: r {i + 1}")
            n = both[0][0], both[1][0]
            try:
                made = horn_fit(n, first[name], second.get(name), options.mirror[i], options.measures, limits.apart)
            except ServoError as error:
                raise ServoError(f"{place}: {error.place}", error.problem, f"{error.remedy}: r {i + 1}") from None
            home = None if options.home is None else options.home[i]
            reach = options.lower[i], options.upper[i]
            refused += refusals(place, made, n, second.get(name), home, reach, limits)
            found.append(
                Found(name, made, n, (first[name], second.get(name)), max(both[0][1], both[1][1]), home, reach)
            )
        if not found:
            raise ServoError("joints", "all are left out", "Calibrate one at least")
        return Calibrated(tuple(found), tuple(left)), tuple(refused)

    def _content(self, result: Result[Calibrated]) -> dict[str, Any]:
        options, found = result.options, result.found
        lines = {
            f.name: {
                "trim": round(f.horn_fit.trim, 6), "direction": f.horn_fit.direction,
                "scale": round(f.horn_fit.scale, 6),
                "known": f.horn_fit.known, "entry": options.joints[f.name],
            }
            for f in found.joints
        }  # fmt: skip
        return {
            "format": FORMAT, "by": options.plan.by, "device": options.device, "driver": options.driver,
            "joints": lines, "left": list(found.left), "uncertain": round(max(f.spread for f in found.joints), 6),
        }  # fmt: skip
