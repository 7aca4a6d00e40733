"""How a data glove is calibrated: the hand takes known shapes, and each sensor's characteristic is found."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration import calibrated_device
from srl.commissioning.calibration.glove import report as glove_report
from srl.commissioning.calibration.glove.fit import GloveError, Thresholds, fit, refusals
from srl.commissioning.calibration.glove.procedure import Procedure
from srl.commissioning.calibration.glove.report import Result
from srl.commissioning.calibration.glove.samples import GloveMarksConfig, Plan, Samples, held, joined
from srl.commissioning.calibration.glove.shapes import Angles
from srl.commissioning.calibration.method import Method, Say, kept, settings
from srl.commissioning.calibration.profile_subset import subset_of_devices
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import MarkedChannels, words
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError, nearest
from srl.runtime.contracts.glove_record import FORMAT, GloveRecord
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

NAME: Final = "glove"
MARKS: Final = "glove-marks"
_HAND: Final = "human-hand"
VENDORS: Final = ".cal"


@dataclass(frozen=True)
class ChannelMap(MarkedChannels):
    """What is read of a glove. Attributes: `options` of the marks' law; `raw` (n,), of all sensors."""

    law = MARKS
    options: GloveMarksConfig
    raw: NDArray[np.intp]

    def _samples(self, times: Array, floats: NDArray[np.float64], marks: NDArray[np.intp]) -> Samples:
        return Samples(times, floats[:, self.raw], marks)


class GloveMethod(Method[ChannelMap, Result]):
    """See the module's docstring."""

    name, law, option, record_type, error = NAME, "", "calibration", GloveRecord, GloveError
    thing = "shapes"
    report: ClassVar[ModuleType] = glove_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        found = _settings(request)
        self._plan, self._angles, self._thresholds = found["plan"], found["angles"], found["thresholds"]
        self._device = calibrated_device.device(checked, source, NAME, self._plan.device)
        if target.suffix == VENDORS:
            problem = f"the glove's driver takes what ends in '{VENDORS}' for the vendor's file"
            raise RequestError("-o", problem, "Name another: -o p07.json")

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        chosen = _settings(request)["plan"].device
        return calibrated_device.named(checked, source, calibrated_device.device(checked, source, NAME, chosen))

    def subset(self, person: str) -> tuple[Profile, Source]:
        def marks(graph: Graph) -> dict[str, Any]:
            return self._marks(person, graph)

        return subset_of_devices(self.checked, self.source, {self._device}, marks, self.request.sim, self._bare)

    def _bare(self, plain: dict[str, Any]) -> None:
        """The glove gives its counts, and a simulated hand does what it is told; nothing else is there."""
        plain["frames"] = {}  # nothing hangs on a glove that is calibrated
        entry = plain["devices"][self._device]
        entry.pop("calibration", None)
        entry["raw"] = True
        if not self.request.sim:
            plain.pop("sim", None)
            return
        sim = plain.get("sim") or {}
        parts: dict[str, Any] = sim.get("parts") or {}
        hands = [name for name, part in parts.items() if part.get("part") == _HAND]
        named = (sim.get("devices") or {}).get(self._device, {}).get("part", self._device)
        hand = named if named in hands else hands[0] if len(hands) == 1 else None
        if hand is None:
            problem = f"the simulated world has {len(hands)} parts '{_HAND}', and none is called '{self._device}'"
            remedy = f"Add one, or name it: sim.devices.{self._device}.part"
            raise ProfileError(self.source.place("sim.parts"), problem, remedy)
        part = {key: value for key, value in parts[hand].items() if key != "at"}
        part["wearer"] = {"instructed": True, "miss": (part.get("wearer") or {}).get("miss", 0.0)}
        sim["parts"] = {hand: part}
        sim.pop("floor", None)  # the hand's origin lies in it, with the arm left out

    def _marks(self, person: str, graph: Graph) -> dict[str, Any]:
        """The entry of the marks' law. Raises WiringError: it doesn't give its sensors' counts."""
        signal = f"{self._device}.raw"
        field = graph.layout.fields.get(signal)
        if field is None or not field.labels:
            place = self.source.place(f"devices.{self._device}")
            raise WiringError(place, f"there is no '{signal}' of named sensors", "Use a driver of srl's for the glove")
        self._check_left(field.labels)
        (driver,) = graph.devices
        return {
            "use": MARKS, "name": MARKS, "person": person, "signal": signal,
            "hand": getattr(driver.config, "hand", "right"), "sensors": list(field.labels),
            "plan": self._plan.model_dump(), "angles": self._angles.model_dump(),
            "thresholds": self._thresholds.model_dump(),
        }  # fmt: skip

    def _check_left(self, sensors: Sequence[str]) -> None:
        """Raises RequestError: what is left to an average hand is no sensor, or all are."""
        for name in self._plan.left:
            if name not in sensors:
                raise RequestError("--option average", f"the glove has no sensor '{name}'", nearest(name, sensors))
        if set(sensors) <= set(self._plan.left):
            raise RequestError("--option average", "no sensor is left to calibrate", "Name fewer")

    def channel_map(self, layout: Layout, place: str) -> ChannelMap:
        mark, options = ChannelMap.marked(layout, place, GloveMarksConfig, "which shape", self.name)
        raw = words(layout, [f"{options.signal}[{name}]" for name in options.sensors], place)
        return ChannelMap(layout, mark, options, raw)

    def ready(self, channel_map: ChannelMap) -> None:
        self._is_ours(channel_map, "--recording")

    def _is_ours(self, channel_map: ChannelMap, place: str) -> None:
        """Raises RequestError: it is of another hand's glove, or of one with other sensors, than the profile's."""
        if channel_map.options.hand != (ours := self.checked.devices[self._device].options.get("hand", "right")):
            problem = f"it is of a {channel_map.options.hand} hand, the profile's glove of a {ours} one"
            raise RequestError(place, problem, "Name a recording of this glove")
        if channel_map.options.sensors != (sensors := self._sensors()):
            problem = (
                f"it is of a glove of {len(channel_map.options.sensors)} sensors, the profile's has {len(sensors)}"
            )
            raise RequestError(place, problem, "Name a recording of this glove")

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        keys = ("signal", "hand", "sensors", "angles", "plan")
        return all(getattr(one.options, key) == getattr(other.options, key) for key in keys)

    def take(self, older: ChannelMap) -> ChannelMap:
        self._is_ours(older, "--from" if self.request.redo else "--recording")  # its samples are joined with ours
        self._plan, self._angles = kept(older.options.plan, self._plan), kept(older.options.angles, self._angles)
        self._thresholds = kept(older.options.thresholds, self._thresholds)
        self._check_left(older.options.sensors)
        update = {"plan": self._plan, "thresholds": self._thresholds, "angles": self._angles}
        return replace(older, options=older.options.model_copy(update=update))

    def procedure(self, before: Sequence[Any]) -> Procedure:
        return Procedure(self._sensors(), self._plan, self._angles, self._thresholds, bool(before))

    def _sensors(self) -> tuple[str, ...]:
        made, _ = self.subset(self.request.person or "P0")
        (entry,) = made.controllers
        return tuple(entry.options["sensors"])

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result:
        options = channel_map.options
        found = held(joined(parts), options.own, options.angles, options.plan, options.thresholds)
        glove = fit([options.sensors[i] for i in options.own], found, options.angles)
        refused = refusals(glove, options.angles, options.thresholds)
        return Result(options, channel_map.simulated, glove, date, refused)

    def record(self, result: Result) -> GloveRecord:
        glove, options = result.glove, result.options
        lines = {
            name: {"gain": float(f"{gain:.8g}"), "offset": round(float(offset), 4), "noise": round(float(noise), 3)}
            for name, gain, offset, noise in zip(glove.sensors, glove.gain, glove.offset, glove.noise, strict=True)
        }
        return GloveRecord.model_validate(
            {
                "format": FORMAT, "person": options.person, "date": result.date, "hand": options.hand,
                "simulated": result.simulated, "signal": options.signal, "sensors": lines,
                "average": [name for name in options.sensors if name in options.plan.left],
                "uncertain": round(float(glove.uncertain.max()), 6), "again": round(float(glove.again.max()), 6),
            }
        )  # fmt: skip


def _settings(request: CalibrationRequest) -> dict[str, Any]:
    return settings(request, {"plan": Plan, "angles": Angles, "thresholds": Thresholds})
