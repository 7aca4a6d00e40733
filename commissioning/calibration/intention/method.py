"""How `intention` is calibrated: the person does each action some times by instruction."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

from srl.commissioning.calibration.intention import report as intention_report
from srl.commissioning.calibration.intention.marks import ROUND, IntentionMarksConfig
from srl.commissioning.calibration.intention.procedure import ACTIONS, Plan, Procedure
from srl.commissioning.calibration.intention.report import Result, Trained
from srl.commissioning.calibration.intention.samples import Samples, trials
from srl.commissioning.calibration.marks import Indices, joined
from srl.commissioning.calibration.method import Method, Say, names
from srl.commissioning.calibration.profile_subset import elements, subset_for
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.suit.channel_map import SuitChannelMap
from srl.control.intention.features import frames, joints, trunk_of
from srl.control.intention.record import Record
from srl.control.intention.training import BACKGROUND, Thresholds, TrainingError, refusals, train
from srl.runtime.contracts.errors import RequestError, WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "intention"


@dataclass(frozen=True)
class ChannelMap(SuitChannelMap):
    """What is read of a suit whose wearer does actions."""

    law, config, unknown = "intention-marks", IntentionMarksConfig, "which samples belong to which action"

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        return Samples(times, frames(*self.poses(floats)), marks)


class IntentionMethod(Method[ChannelMap, Trained]):
    """See the module's docstring."""

    law, option, record_type, error, channels = LAW, "recogniser", Record, TrainingError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    thing = "actions"
    counted = range(ROUND, 1 << 31)
    report: ClassVar[ModuleType] = intention_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        if self._plan.rounds < self._thresholds.repetitions:
            problem = f"{self._plan.rounds} rounds give fewer than {self._thresholds.repetitions} repetitions"
            raise RequestError("--option rounds", problem, "Give more")
        self._actions = names("--actions", request.actions, "an action") or ACTIONS
        for name in self._actions:
            if name in BACKGROUND or (request.sim and name not in ACTIONS):
                problem = f"'{name}' is no action" if name in BACKGROUND else f"a simulated wearer can't do '{name}'"
                raise RequestError("--actions", problem, nearest(name, ACTIONS))
        if len(self._actions) < 2:
            raise RequestError("--actions", "one alone can't be told from others", "Name two or more")

    def subset(self, person: str) -> tuple[Profile, Source]:
        marks = partial(self._marks, person)
        return subset_for(self.checked, self.source, LAW, ("rotation", "translation"), marks, self.request.sim)

    def _marks(self, person: str, graph: Graph, entry: ControllerEntry) -> dict[str, Any]:
        """The entry of the marks' law: where each joint's rotation and translation are."""
        found = {port: elements(graph, LAW, entry, port) for port in ("rotation", "translation")}
        trunk = trunk_of(tuple(found["rotation"]))
        needed = joints(trunk)
        for port, places in found.items():
            if not trunk or (missing := [name for name in needed if name not in places]):
                problem = f"it has no joint '{missing[0] if trunk else 'Spine'}'"
                raise WiringError(f"the input '{port}' of {LAW}", problem, "Wire a whole suit, or rename with `map:`")
        poses = {port: {name: places[name] for name in needed} for port, places in found.items()}
        return self._entry(person=person, actions=list(self._actions), trunk=list(trunk), **poses)

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return (one.options.actions, one.options.trunk) == (other.options.actions, other.options.trunk)

    def take(self, older: ChannelMap) -> ChannelMap:
        if self.request.actions and older.options.actions != self._actions:
            problem = f"they are of {', '.join(older.options.actions)}"
            raise RequestError("--actions", problem, "Name recordings of the same actions")
        taken = super().take(older)
        self._actions = taken.options.actions
        return taken

    def procedure(self, before: Sequence[Any]) -> Procedure:
        return Procedure(self._actions, self._plan, bool(before))

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result[Trained]:
        thresholds = channel_map.options.thresholds
        made, held = train(trials(_joined(parts), channel_map.options.actions, thresholds), thresholds)
        return Result(channel_map, Trained(made, held), date, refusals(made, held, thresholds))

    def record(self, result: Result[Trained]) -> Record:
        options = result.options
        return Record.of(
            result.found.made, result.found.held, options.thresholds, person=options.person, date=result.date,
            simulated=result.simulated, trunk=options.trunk,
        )  # fmt: skip


def _joined(parts: Sequence[Samples]) -> list[Samples]:
    """One run's pieces make one; where the time goes back, another run begins."""
    runs: list[list[Samples]] = []
    for part in parts:
        if not len(part):
            continue
        if not runs or part.times[0] <= runs[-1][-1].times[-1]:
            runs.append([])
        runs[-1].append(part)
    return [joined(run) for run in runs]
