"""How a force/torque sensor is calibrated: held still in several poses, its bias and its tool's load are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

import numpy as np

from srl.commissioning.calibration.ft import report as ft_report
from srl.commissioning.calibration.ft.fit import FEWEST, FtError, Load, Thresholds, bias_alone, fit, refusals
from srl.commissioning.calibration.ft.procedure import Procedure
from srl.commissioning.calibration.ft.report import Result
from srl.commissioning.calibration.ft.samples import FtMarksConfig, Plan, Samples, poses
from srl.commissioning.calibration.in_hand import take_in_hand
from srl.commissioning.calibration.marks import Indices, joined
from srl.commissioning.calibration.method import FittedMethod, Say
from srl.commissioning.calibration.profile_subset import elements, find, subset_for
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.control.cobot.ft_record import FORMAT, FtRecord
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import WRENCH
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "admittance"


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of a sensor: `wrench` (6,), and its `frame`; None where its device names none."""

    law, config, unknown = "ft-marks", FtMarksConfig, "which samples belong to which pose"
    wrench: Indices
    frame: str | None

    @classmethod
    def places(cls, layout: Layout, options: FtMarksConfig, place: str) -> tuple[Any, ...]:
        return words(layout, list(options.wrench.values()), place), layout.fields[options.signal].frame

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        return Samples(times, floats[:, self.wrench], marks)


class FtMethod(FittedMethod[ChannelMap, Load]):
    """See the module's docstring."""

    name, law, record_type, error, channels = "ft", LAW, FtRecord, FtError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    fixed = ("plan",)
    personal = False
    thing = "poses"
    report: ClassVar[ModuleType] = ft_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        if 1 < self._plan.poses < FEWEST:
            problem = f"{self._plan.poses} poses don't find the load: {FEWEST} are needed"
            raise RequestError("--option poses", problem, "Give more; 1 finds the bias alone")
        self._device = self._sensor()

    def _sensor(self) -> str:
        """The sensor, a device. Raises WiringError: the law doesn't read one; ProfileError: it makes its own zero."""
        law = find(self.checked, self.source, LAW)
        wire = self.checked.controllers[law].inputs.get("wrench")
        signals = () if wire is None else wire.signals
        device = signals[0].partition(".")[0] if len(signals) == 1 else ""
        if device not in self.checked.devices:
            place = self.source.place(f"controllers.{law}.in")
            raise WiringError(place, "'wrench' isn't one signal of a device", "Add `wrench: SENSOR.wrench`")
        if self.checked.devices[device].options.get("bias"):
            problem = "it takes what it shows at its opening for zero, so what is found now isn't so in the next run"
            raise ProfileError(self.source.place(f"devices.{device}.bias"), problem, "Leave `bias: true` out")
        return device

    def subset(self, person: str) -> tuple[Profile, Source]:
        reads = ("wrench",)
        return subset_for(self.checked, self.source, LAW, reads, self._marks, self.request.sim, reads, self._held)

    def _marks(self, graph: Graph, entry: ControllerEntry) -> dict[str, Any]:
        """The entry of the marks' law."""
        found = elements(graph, LAW, entry, "wrench")
        if missing := [axis for axis in WRENCH if axis not in found]:
            raise WiringError(f"the input 'wrench' of {LAW}", f"it has no '{missing[0]}'", "Wire a six-axis sensor")
        (signal,) = entry.inputs["wrench"].signals
        return self._entry(signal=signal, wrench={axis: found[axis] for axis in WRENCH})

    def _held(self, plain: dict[str, Any]) -> None:
        """Nothing that the profile describes is there, but the sensor and what the person holds in the hands."""
        plain["devices"] = {self._device: plain["devices"][self._device]}
        if plain.get("clock") != self._device:
            plain.pop("clock", None)
        frame = self.checked.devices[self._device].options.get("frame")
        if self.request.sim:
            take_in_hand(plain, self._device, frame, self.source.place("sim.parts"))
        else:
            plain["frames"] = {}

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return (one.options.signal, one.options.plan.poses) == (other.options.signal, other.options.plan.poses)

    def procedure(self, before: Sequence[Any]) -> Procedure:
        done = poses(joined(before), self._plan, self._thresholds)[0] if before else None
        return Procedure(self._plan, self._thresholds, done)

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Load, tuple[FtError, ...]]:
        plan, thresholds = channel_map.options.plan, channel_map.options.thresholds
        found, noise = poses(samples, plan, thresholds)
        numbers, wrench = tuple(found), np.array(list(found.values()))
        alone = plan.poses == 1
        load = bias_alone(numbers[0], wrench[0], noise) if alone else fit(numbers, wrench, noise, thresholds)
        return load, refusals(load, thresholds)

    def _content(self, result: Result[Load]) -> dict[str, Any]:
        load = result.found
        return {
            "format": FORMAT, "signal": result.options.signal, "frame": result.channel_map.frame,
            "poses": len(load.numbers), "bias": load.bias.round(6).tolist(), "tool_mass": round(load.mass, 6),
            "tool_com": load.com.round(6).tolist(), "left": load.most, "uncertain": load.uncertain,
        }  # fmt: skip
