"""How surface EMG is calibrated: rest, then each muscle's greatest voluntary contraction, some times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from math import ceil
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

from srl.commissioning.calibration.emg import report as emg_report
from srl.commissioning.calibration.emg.fit import Mvc, Thresholds, fit, refusals
from srl.commissioning.calibration.emg.procedure import Procedure
from srl.commissioning.calibration.emg.report import Result
from srl.commissioning.calibration.emg.samples import EmgMarksConfig, Plan, Samples, parts
from srl.commissioning.calibration.marks import Indices, joined
from srl.commissioning.calibration.method import FittedMethod, Say
from srl.commissioning.calibration.profile_subset import find, subset_for
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels, marks_law, words
from srl.control.emg.processing import EmgError, OnlineEnvelope
from srl.control.emg.record import FORMAT, EmgRecord
from srl.runtime.contracts.errors import RequestError, WiringError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "emg-activation"
_PART: Final = "muscles"
_FASTEST: Final = Fraction(100)  # Hz, of the calibration's rows
_FRAME: Final = 27  # samples that come at once; a row must hold a cycle's and these


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of the device: `block` (k n,), `count` (1,), `shape` (k, n)."""

    law, config, unknown = "emg-marks", EmgMarksConfig, "which samples belong to which contraction"
    block: Indices
    count: Indices
    shape: tuple[int, ...]

    @classmethod
    def places(cls, layout: Layout, options: EmgMarksConfig, place: str) -> tuple[Any, ...]:
        block, count = (words(layout, [name], place) for name in (options.signal, options.count))
        return block, count, layout.fields[options.signal].shape

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        blocks = floats[:, self.block].reshape(-1, *self.shape)
        return Samples(times, blocks, floats[:, self.count[0]], marks)


class EmgMethod(FittedMethod[ChannelMap, Mvc]):
    """See the module's docstring."""

    name, law, record_type, error, channels = "emg", LAW, EmgRecord, EmgError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    thing = "muscles"
    counted = range(1, 1 << 31)
    report: ClassVar[ModuleType] = emg_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        self._device = self._emg()

    def _emg(self) -> str:
        """The device. Raises WiringError: the law doesn't read one."""
        law = find(self.checked, self.source, LAW)
        inputs = self.checked.controllers[law].inputs
        owners = {s.partition(".")[0] for name in ("samples", "count") if name in inputs for s in inputs[name].signals}
        if len(owners) != 1 or not owners <= set(self.checked.devices):
            place = self.source.place(f"controllers.{law}.in")
            problem = "'samples' and 'count' aren't those of one device"
            raise WiringError(place, problem, "Add `samples: emg.samples` and `count: emg.count`")
        return owners.pop()

    def subset(self, person: str) -> tuple[Profile, Source]:
        reads, marks = ("samples", "count"), partial(self._marks, person)
        return subset_for(self.checked, self.source, LAW, reads, marks, self.request.sim, reads, self._bare)

    def _marks(self, person: str, graph: Graph, entry: ControllerEntry) -> dict[str, Any]:
        """The entry of the marks' law. Raises WiringError: the device's samples have no muscles' names."""
        signal, count = f"{self._device}.samples", f"{self._device}.count"
        field = graph.layout.fields.get(signal)
        if field is None or count not in graph.layout.fields or not field.components:
            problem = f"there is no '{signal}' of named muscles beside '{count}'"
            remedy = "Use the driver `trigno`, or `lsl` with a signal `samples` that has a `block`"
            raise WiringError(f"the input 'samples' of {LAW}", problem, remedy)
        channels = _slots(graph.profile.devices[self._device].options)
        muscles = list(field.components[0])
        return self._entry(person=person, signal=signal, count=count, channels=channels, muscles=muscles)

    def _bare(self, plain: dict[str, Any]) -> None:
        """The device alone, with all its samples in each row; and simulated muscles that do what they are told."""
        plain["frames"] = {}
        entry = plain["devices"][self._device]
        rate = self.checked.rate
        if rate > _FASTEST:  # rows overlap: a fast loop's would fill the memory
            plain["rate"] = 100
            rate = _FASTEST
        needed = ceil(self._plan.rate / float(rate)) + _FRAME
        stated = entry.get("rate")
        if stated is not None and float(stated) != self._plan.rate:
            place = self.source.place(f"devices.{self._device}.rate")
            raise WiringError(place, f"{stated:g} Hz isn't what is calibrated at", f"Add `--option rate={stated:g}`")
        asked = _asked(entry)
        asked["block"] = max(int(asked.get("block") or 0), needed)
        if not self.request.sim:
            plain.pop("sim", None)
            return
        sim = plain.get("sim") or {}
        given: dict[str, Any] = sim.get("parts") or {}
        own = next(
            ((name, part) for name, part in given.items() if part.get("part") == _PART), (_PART, {"part": _PART})
        )
        sim["parts"] = {own[0]: own[1]}
        device = dict((sim.get("devices") or {}).get(self._device) or {})
        device.pop("activation", None)
        sim["devices"] = {self._device: device | {"part": own[0]}}
        plain["sim"] = sim | {"world": "cell"}

    def _check(self, channel_map: ChannelMap, place: str) -> None:
        ours = _slots(self.checked.devices[self._device].options)
        theirs = _channels(channel_map.layout, self._device)
        if tuple(channel_map.options.muscles) != tuple(ours) or theirs != ours:
            both = " and ".join(", ".join(f"{k}: {v}" for k, v in each.items()) for each in (theirs, ours))
            problem = f"it is of other muscles or slots than the profile's: {both}"
            raise RequestError(place, problem, "Name a recording of these electrodes")

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        mine, theirs = one.options, other.options
        return (mine.signal, mine.muscles, mine.plan) == (theirs.signal, theirs.muscles, theirs.plan) and (
            one.shape == other.shape
        )

    def procedure(self, before: Sequence[Any]) -> Procedure:
        muscles = tuple(_slots(self.checked.devices[self._device].options))
        level = None
        if before:
            filters = self._plan.filters()
            rest, _ = parts(joined(before), (), self._plan)
            settled = round(filters.rate / filters.cutoff)
            level = OnlineEnvelope(len(muscles), filters).take(rest)[settled:].mean(axis=0)
        return Procedure(muscles, self._plan, self._thresholds, level)

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Mvc, tuple[EmgError, ...]]:
        options = channel_map.options
        rest, contractions = parts(samples, options.muscles, options.plan)
        found = fit(options.muscles, rest, contractions, options.plan.filters(), options.plan.window)
        return found, refusals(found, options.thresholds)

    def _content(self, result: Result[Mvc]) -> dict[str, Any]:
        found, options = result.found, result.options
        filters = options.plan.filters()
        muscles = {
            name: {"rest": _rounded(found.rest[i]), "mvc": _rounded(found.mvc[i]), "repeats": list(map(_rounded, own))}
            for i, (name, own) in enumerate(zip(found.muscles, found.own, strict=True))
        }
        return {
            "format": FORMAT, "signal": options.signal, "channels": options.channels,
            "rate": filters.rate, "band": filters.band, "band_order": filters.band_order,
            "cutoff": filters.cutoff, "cutoff_order": filters.cutoff_order, "window": options.plan.window,
            "muscles": muscles,
        }  # fmt: skip


def _asked(options: dict[str, Any]) -> dict[str, Any]:
    """Where a device's options have `channels` and `block`: those of its signal `samples`, if it names its signals."""
    found: dict[str, Any] = (options.get("signals") or {}).get("samples", options)
    return found


def _slots(options: dict[str, Any]) -> dict[str, int]:
    """Each muscle's slot, as a device's options have it."""
    return dict(_asked(options).get("channels") or {})


def _rounded(volts: float) -> float:
    return float(f"{volts:.6g}")


def _channels(layout: Layout, device: str) -> dict[str, int]:
    """The muscles' slots in a layout's own profile."""
    checked, _ = marks_law(layout, "recording", ChannelMap.law)
    entry = checked.devices.get(device)
    return _slots(entry.options) if entry is not None else {}
