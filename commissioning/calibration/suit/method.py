"""How a capture suit is calibrated: the person stands the same way again and again, and walks in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from srl.commissioning.calibration.calibrated_device import WornMethod
from srl.commissioning.calibration.marks import Indices
from srl.commissioning.calibration.method import Say
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.commissioning.calibration.suit import report as suit_report
from srl.commissioning.calibration.suit.fit import Suit, Thresholds, fit, refusals
from srl.commissioning.calibration.suit.procedure import Procedure
from srl.commissioning.calibration.suit.report import Result
from srl.commissioning.calibration.suit.samples import Plan, Samples, SuitMarksConfig, stands
from srl.commissioning.calibration.suit.segments import SuitError, segments
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.suit_record import FORMAT, SuitRecord
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of a suit: `rotation` (4 n,), of its segments."""

    law, config, unknown = "suit-marks", SuitMarksConfig, "which samples belong to which stand"
    rotation: Indices

    @classmethod
    def places(cls, layout: Layout, options: SuitMarksConfig, place: str) -> tuple[Any, ...]:
        return (words(layout, [f"{options.signal}[{name}]" for name in options.segments], place),)

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        return Samples(times, floats[:, self.rotation].reshape(len(floats), -1, 4), marks)


class SuitMethod(WornMethod[ChannelMap, Suit]):
    """See the module's docstring."""

    name, record_type, error, channels = "suit", SuitRecord, SuitError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    thing = "stands"
    part = "body"
    report: ClassVar[ModuleType] = suit_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        if request.redo:
            problem = "a drift is seen within one session, without a break"
            raise RequestError("--redo", problem, "Begin anew; within a session, type r N")
        if request.sim and self._plan.pose != "n":
            raise RequestError("--option pose", "the simulated person lets the arms hang", "Leave it out")

    def _instructed(self, part: dict[str, Any]) -> dict[str, Any]:
        gone = ("at", "script", "recording", "loop")
        return {key: value for key, value in part.items() if key not in gone} | {"script": "actions"}

    def _marks(self, person: str, graph: Graph) -> dict[str, Any]:
        signal = f"{self._device}.rotation"
        found = segments(self._signal(graph, signal, "joints", "Use a driver of srl's for the suit"))
        return self._entry(
            person=person, signal=signal, segments=[name for name, _ in found], parents=[up for _, up in found]
        )

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return False  # a drift is seen within one session

    def procedure(self, before: Sequence[Any]) -> Procedure:
        options = self._own_options()
        return Procedure(options.segments, options.parents, self._plan, self._thresholds)

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Suit, tuple[SuitError, ...]]:
        options = channel_map.options
        found = fit(options.segments, stands(samples, options.parents, options.plan, options.thresholds))
        return found, refusals(found, options.plan.pose, options.thresholds)

    def _content(self, result: Result[Suit]) -> dict[str, Any]:
        found, options = result.found, result.options
        drifts = {
            name: {"rate": round(float(rate), 8), "uncertain": round(float(sure), 8), "measured": bool(seen)}
            for name, rate, sure, seen in zip(found.segments, found.rates, found.uncertain, found.measured, strict=True)
        }
        times = found.stands.times
        return {
            "format": FORMAT, "signal": options.signal, "pose": options.plan.pose, "heading": round(found.heading, 6),
            "uncertain": round(found.scatter, 6), "stands": len(times), "seconds": float(times[-1] - times[0]),
            "drifts": drifts,
        }  # fmt: skip
