"""How a capture suit is calibrated: the person stands the same way again and again, and walks in between."""

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
from srl.commissioning.calibration.method import Method, Say, kept, settings
from srl.commissioning.calibration.profile_subset import subset_of_devices
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import MarkedChannels, words
from srl.commissioning.calibration.suit import report as suit_report
from srl.commissioning.calibration.suit.fit import Thresholds, fit, refusals
from srl.commissioning.calibration.suit.procedure import Procedure
from srl.commissioning.calibration.suit.report import Result
from srl.commissioning.calibration.suit.samples import Plan, Samples, SuitMarksConfig, joined, stands
from srl.commissioning.calibration.suit.segments import SuitError, segments
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.suit_record import FORMAT, SuitRecord
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

NAME: Final = "suit"
MARKS: Final = "suit-marks"
_BODY: Final = "body"


@dataclass(frozen=True)
class ChannelMap(MarkedChannels):
    """What is read of a suit. Attributes: `options` of the marks' law; `rotation` (4 n,), of its segments."""

    law = MARKS
    options: SuitMarksConfig
    rotation: NDArray[np.intp]

    def _samples(self, times: Array, floats: NDArray[np.float64], marks: NDArray[np.intp]) -> Samples:
        rotation = floats[:, self.rotation].reshape(len(floats), -1, 4)
        return Samples(times, rotation, marks)


class SuitMethod(Method[ChannelMap, Result]):
    """See the module's docstring."""

    name, law, option, record_type, error = NAME, "", "calibration", SuitRecord, SuitError
    thing = "stands"
    report: ClassVar[ModuleType] = suit_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        found = settings(request, {"plan": Plan, "thresholds": Thresholds})
        self._plan, self._thresholds = found["plan"], found["thresholds"]
        self._device = calibrated_device.device(checked, source, NAME, self._plan.device)
        if request.redo:
            problem = "a drift is seen within one session, without a break"
            raise RequestError("--redo", problem, "Begin anew; within a session, type r N")
        if request.sim and self._plan.pose != "n":
            raise RequestError("--option pose", "the simulated person lets the arms hang", "Leave it out")

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        chosen = settings(request, {"plan": Plan, "thresholds": Thresholds})["plan"].device
        return calibrated_device.named(checked, source, calibrated_device.device(checked, source, NAME, chosen))

    def subset(self, person: str) -> tuple[Profile, Source]:
        def marks(graph: Graph) -> dict[str, Any]:
            return self._marks(person, graph)

        return subset_of_devices(self.checked, self.source, {self._device}, marks, self.request.sim, self._bare)

    def _bare(self, plain: dict[str, Any]) -> None:
        """The suit gives what it sends, and a simulated person does what it is told; nothing else is there."""
        plain["frames"] = {}
        plain["devices"][self._device].pop("calibration", None)
        if not self.request.sim:
            plain.pop("sim", None)
            return
        sim = plain.get("sim") or {}
        parts: dict[str, Any] = sim.get("parts") or {}
        bodies = [name for name, part in parts.items() if part.get("part") == _BODY]
        named = (sim.get("devices") or {}).get(self._device, {}).get("part", self._device)
        body = named if named in bodies else bodies[0] if len(bodies) == 1 else None
        if body is None:
            problem = f"the simulated world has {len(bodies)} parts '{_BODY}', and none is called '{self._device}'"
            remedy = f"Add one, or name it: sim.devices.{self._device}.part"
            raise ProfileError(self.source.place("sim.parts"), problem, remedy)
        gone = ("at", "script", "recording", "loop")
        part = {key: value for key, value in parts[body].items() if key not in gone}
        sim["parts"] = {body: part | {"script": "actions"}}

    def _marks(self, person: str, graph: Graph) -> dict[str, Any]:
        """The entry of the marks' law. Raises WiringError: the device doesn't give the rotations of a body."""
        signal = f"{self._device}.rotation"
        field = graph.layout.fields.get(signal)
        if field is None or not field.labels:
            place = self.source.place(f"devices.{self._device}")
            raise WiringError(place, f"there is no '{signal}' of named joints", "Use a driver of srl's for the suit")
        found = segments(field.labels)
        return {
            "use": MARKS, "name": MARKS, "person": person, "signal": signal,
            "segments": [name for name, _ in found], "parents": [up for _, up in found],
            "plan": self._plan.model_dump(), "thresholds": self._thresholds.model_dump(),
        }  # fmt: skip

    def channel_map(self, layout: Layout, place: str) -> ChannelMap:
        mark, options = ChannelMap.marked(layout, place, SuitMarksConfig, "which stand", self.name)
        rotation = words(layout, [f"{options.signal}[{name}]" for name in options.segments], place)
        return ChannelMap(layout, mark, options, rotation)

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return False  # a drift is seen within one session

    def take(self, older: ChannelMap) -> ChannelMap:
        self._plan = kept(older.options.plan, self._plan)
        self._thresholds = kept(older.options.thresholds, self._thresholds)
        update = {"plan": self._plan, "thresholds": self._thresholds}
        return replace(older, options=older.options.model_copy(update=update))

    def procedure(self, before: Sequence[Any]) -> Procedure:
        made, _ = self.subset(self.request.person or "P0")
        (entry,) = made.controllers
        return Procedure(entry.options["segments"], entry.options["parents"], self._plan, self._thresholds)

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result:
        options = channel_map.options
        found = fit(options.segments, stands(joined(parts), options.parents, options.plan, options.thresholds))
        refused = refusals(found, options.plan.pose, options.thresholds)
        return Result(options, channel_map.simulated, found, date, refused)

    def record(self, result: Result) -> SuitRecord:
        found, options = result.found, result.options
        drifts = {
            name: {"rate": round(float(rate), 8), "uncertain": round(float(sure), 8), "measured": bool(seen)}
            for name, rate, sure, seen in zip(found.segments, found.rates, found.uncertain, found.measured, strict=True)
        }
        times = found.stands.times
        return SuitRecord.model_validate(
            {
                "format": FORMAT, "person": options.person, "date": result.date, "simulated": result.simulated,
                "signal": options.signal, "pose": options.plan.pose, "heading": round(found.heading, 6),
                "uncertain": round(found.scatter, 6), "stands": len(times), "seconds": float(times[-1] - times[0]),
                "drifts": drifts,
            }
        )  # fmt: skip
