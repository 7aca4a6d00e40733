"""How `intention` is calibrated: the person does each action some times by instruction."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.intention import report as intention_report
from srl.commissioning.calibration.intention.marks import IntentionMarksConfig
from srl.commissioning.calibration.intention.procedure import ACTIONS, Plan, Procedure
from srl.commissioning.calibration.intention.report import Result
from srl.commissioning.calibration.intention.samples import Samples, ended, trials
from srl.commissioning.calibration.method import Method, Say, kept, names, settings
from srl.commissioning.calibration.profile_subset import elements, subset_for
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.suit.channel_map import SuitChannelMap
from srl.control.intention.features import frames, joints, trunk_of
from srl.control.intention.record import Record
from srl.control.intention.training import BACKGROUND, Thresholds, TrainingError, refusals, train
from srl.runtime.contracts.errors import RequestError, WiringError, nearest
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "intention"
MARKS: Final = "intention-marks"


@dataclass(frozen=True)
class ChannelMap(SuitChannelMap[IntentionMarksConfig]):
    """What is read of a suit whose wearer does actions."""

    def samples(self, rows: NDArray[np.int64]) -> Samples:
        rows = rows[self.active(rows)]
        floats = self.floats(rows)
        return Samples(self.times(rows), frames(*self.poses(floats)), self.marks(floats))


class IntentionMethod(Method[ChannelMap, Result]):
    """See the module's docstring."""

    law, option, record_type, error = LAW, "recogniser", Record, TrainingError
    thing = "actions"
    report: ClassVar[ModuleType] = intention_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        found = settings(request, {"plan": Plan, "thresholds": Thresholds})
        self._plan, self._thresholds = found["plan"], found["thresholds"]
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
        marks = partial(_marks, person, self._actions, self._thresholds)
        return subset_for(self.checked, self.source, LAW, ("rotation", "translation"), marks, self.request.sim)

    def channel_map(self, layout: Layout, place: str) -> ChannelMap:
        return ChannelMap.find(
            layout, place, MARKS, lambda entry, _: IntentionMarksConfig.model_validate(entry),
            "which samples belong to which action", LAW,
        )  # fmt: skip

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return (one.options.actions, one.options.trunk) == (other.options.actions, other.options.trunk)

    def take(self, older: ChannelMap) -> ChannelMap:
        if self.request.actions and older.options.actions != self._actions:
            problem = f"they are of {', '.join(older.options.actions)}"
            raise RequestError("--actions", problem, "Name recordings of the same actions")
        thresholds = kept(older.options.thresholds, self._thresholds)
        older = replace(older, options=older.options.model_copy(update={"thresholds": thresholds}))
        self._actions, self._thresholds = older.options.actions, older.options.thresholds
        return older

    def ended(self, samples: Samples) -> Samples:
        return ended(samples)

    def procedure(self, before: Sequence[Any]) -> Procedure:
        return Procedure(self._actions, self._plan, bool(before))

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result:
        thresholds = channel_map.options.thresholds
        made, held = train(trials(_joined(parts), channel_map.options.actions, thresholds), thresholds)
        return Result(channel_map, made, held, date, refusals(made, held, thresholds))

    def record(self, result: Result) -> Record:
        options = self._options(result)
        return Record.of(
            result.made, result.held, options.thresholds, person=options.person, date=result.date,
            simulated=result.channel_map.simulated, trunk=options.trunk,
        )  # fmt: skip

    @staticmethod
    def _options(result: Result) -> IntentionMarksConfig:
        assert isinstance(result.channel_map, ChannelMap)
        return result.channel_map.options


def _joined(parts: Sequence[Samples]) -> list[Samples]:
    """One run's pieces make one; where the time goes back, another run begins."""
    runs: list[list[Samples]] = []
    for part in parts:
        if not len(part):
            continue
        if not runs or part.times[0] <= runs[-1][-1].times[-1]:
            runs.append([])
        runs[-1].append(part)
    return [
        Samples(*(np.concatenate([getattr(p, k) for p in run]) for k in ("times", "frames", "marks"))) for run in runs
    ]


def _marks(
    person: str, actions: tuple[str, ...], thresholds: Thresholds, graph: Graph, entry: ControllerEntry
) -> dict[str, Any]:
    """The entry of the marks' law: where each joint's rotation and translation are."""
    found = {port: elements(graph, LAW, entry, port) for port in ("rotation", "translation")}
    trunk = trunk_of(tuple(found["rotation"]))
    needed = joints(trunk)
    for port, places in found.items():
        if not trunk or (missing := [name for name in needed if name not in places]):
            problem = f"it has no joint '{missing[0] if trunk else 'Spine'}'"
            raise WiringError(f"the input '{port}' of {LAW}", problem, "Wire a whole suit, or rename with `map:`")
    return {
        "use": MARKS, "name": MARKS, "person": person, "actions": list(actions), "trunk": list(trunk),
        "rotation": {name: found["rotation"][name] for name in needed},
        "translation": {name: found["translation"][name] for name in needed},
        "thresholds": thresholds.model_dump(),
    }  # fmt: skip
