"""How a data glove is calibrated: the hand takes known shapes, and each sensor's characteristic is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

from srl.commissioning.calibration.calibrated_device import WornMethod
from srl.commissioning.calibration.glove import report as glove_report
from srl.commissioning.calibration.glove.fit import Glove, GloveError, Thresholds, fit, refusals
from srl.commissioning.calibration.glove.procedure import Procedure
from srl.commissioning.calibration.glove.report import Result
from srl.commissioning.calibration.glove.samples import GloveMarksConfig, Plan, Samples, held
from srl.commissioning.calibration.glove.shapes import Angles
from srl.commissioning.calibration.marks import Indices
from srl.commissioning.calibration.method import Say
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.glove_record import FORMAT, GloveRecord
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

VENDORS: Final = ".cal"


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of a glove: `raw` (n,), of all sensors."""

    law, config, unknown = "glove-marks", GloveMarksConfig, "which samples belong to which shape"
    raw: Indices

    @classmethod
    def places(cls, layout: Layout, options: GloveMarksConfig, place: str) -> tuple[Any, ...]:
        return (words(layout, [f"{options.signal}[{name}]" for name in options.sensors], place),)

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        return Samples(times, floats[:, self.raw], marks)


class GloveMethod(WornMethod[ChannelMap, Glove]):
    """See the module's docstring."""

    name, record_type, error, channels = "glove", GloveRecord, GloveError, ChannelMap
    groups: ClassVar = {"plan": Plan, "angles": Angles, "thresholds": Thresholds}
    thing = "shapes"
    part = "human-hand"
    report: ClassVar[ModuleType] = glove_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        if target.suffix == VENDORS:
            problem = f"the glove's driver takes what ends in '{VENDORS}' for the vendor's file"
            raise RequestError("-o", problem, "Name another: -o p07.json")

    def _bare(self, plain: dict[str, Any]) -> None:
        super()._bare(plain)
        plain["devices"][self._device]["raw"] = True
        (plain.get("sim") or {}).pop("floor", None)  # the hand's origin lies in it, with the arm left out

    def _instructed(self, part: dict[str, Any]) -> dict[str, Any]:
        part.pop("at", None)
        return part | {"wearer": {"instructed": True, "miss": (part.get("wearer") or {}).get("miss", 0.0)}}

    def _marks(self, person: str, graph: Graph) -> dict[str, Any]:
        signal = f"{self._device}.raw"
        sensors = self._signal(graph, signal, "sensors", "Use a driver of srl's for the glove")
        self._check_left(sensors)
        (driver,) = graph.devices
        hand = getattr(driver.config, "hand", "right")
        return self._entry(person=person, signal=signal, hand=hand, sensors=list(sensors))

    def _check_left(self, sensors: Sequence[str]) -> None:
        """Raises RequestError: what is left to an average hand is no sensor, or all are."""
        for name in self._plan.left:
            if name not in sensors:
                raise RequestError("--option average", f"the glove has no sensor '{name}'", nearest(name, sensors))
        if set(sensors) <= set(self._plan.left):
            raise RequestError("--option average", "no sensor is left to calibrate", "Name fewer")

    def _check(self, channel_map: ChannelMap, place: str) -> None:
        theirs, remedy = channel_map.options, "Name a recording of this glove"
        if theirs.hand != (ours := self.checked.devices[self._device].options.get("hand", "right")):
            problem = f"it is of a {theirs.hand} hand, the profile's glove of a {ours} one"
            raise RequestError(place, problem, remedy)
        if theirs.sensors != (sensors := self._own_options().sensors):
            problem = f"it is of a glove of {len(theirs.sensors)} sensors, the profile's has {len(sensors)}"
            raise RequestError(place, problem, remedy)

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        keys = ("signal", "hand", "sensors", "angles", "plan")
        return all(getattr(one.options, key) == getattr(other.options, key) for key in keys)

    def take(self, older: ChannelMap) -> ChannelMap:
        taken = super().take(older)
        self._check_left(older.options.sensors)
        return taken

    def procedure(self, before: Sequence[Any]) -> Procedure:
        sensors, angles = self._own_options().sensors, self._settings["angles"]
        return Procedure(sensors, self._plan, angles, self._thresholds, bool(before))

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Glove, tuple[GloveError, ...]]:
        options = channel_map.options
        found = held(samples, options.own, options.angles, options.plan, options.thresholds)
        glove = fit([options.sensors[i] for i in options.own], found, options.angles)
        return glove, refusals(glove, options.angles, options.thresholds)

    def _content(self, result: Result[Glove]) -> dict[str, Any]:
        glove, options = result.found, result.options
        lines = {
            name: {"gain": float(f"{gain:.8g}"), "offset": round(float(offset), 4), "noise": round(float(noise), 3)}
            for name, gain, offset, noise in zip(glove.sensors, glove.gain, glove.offset, glove.noise, strict=True)
        }
        return {
            "format": FORMAT, "hand": options.hand, "signal": options.signal, "sensors": lines,
            "average": [name for name in options.sensors if name in options.plan.left],
            "uncertain": round(float(glove.uncertain.max()), 6), "again": round(float(glove.again.max()), 6),
        }  # fmt: skip
