"""How a task for `independent-operation` is shown: the hand does it once, and the path is checked and kept."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.marks import stretch_of
from srl.commissioning.calibration.method import Method, Say, kept, settings
from srl.commissioning.calibration.picture import save
from srl.commissioning.calibration.profile_subset import elements, subset_for
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.suit.channel_map import SuitChannelMap
from srl.commissioning.calibration.task.procedure import Plan, Procedure
from srl.commissioning.calibration.task.samples import SHOWN, Samples, TaskMarksConfig
from srl.control.operation.demonstration import TaskError, TaskPath, Thresholds, path_of
from srl.control.operation.reach import MOST, Reach
from srl.control.operation.record import FORMAT, TaskRecord
from srl.control.operation.worn import Worn
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.models import context
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "independent-operation"
MARKS: Final = "task-marks"


@dataclass(frozen=True)
class ChannelMap(SuitChannelMap[TaskMarksConfig]):
    """What is read of a suit whose wearer shows a path."""

    def samples(self, rows: NDArray[np.int64]) -> Samples:
        rows = rows[self.active(rows)]
        floats = self.floats(rows)
        rotation, translation = self.poses(floats)
        hand = np.full((len(rows), 3), np.nan)
        arm = worn(self.options)
        good = np.isfinite(rotation).all(axis=(1, 2)) & np.isfinite(translation).all(axis=(1, 2))
        for i in np.flatnonzero(good):
            arm.see(rotation[i], translation[i], 0.0)
            hand[i] = arm.place(self.options.hand)
        return Samples(self.times(rows), hand, self.marks(floats))


@dataclass(frozen=True)
class Result:
    """A path with what its report tells. `refusals`: none; a path that can't be used isn't computed."""

    channel_map: ChannelMap
    path: TaskPath
    shown: Array  # (k, 3) m, the hand's samples
    date: datetime.date
    refusals: tuple[TaskError, ...] = ()


class TaskMethod(Method[ChannelMap, Result]):
    """See the module's docstring."""

    law, option, record_type, error = LAW, "task", TaskRecord, TaskError
    thing = "tasks"
    counted = range(SHOWN, SHOWN + 1)

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        found = settings(request, {"plan": Plan, "thresholds": Thresholds})
        self._plan, self._thresholds = found["plan"], found["thresholds"]

    def subset(self, person: str) -> tuple[Profile, Source]:
        reads = ("rotation", "translation")
        marks = partial(_marks, person, self._thresholds)
        return subset_for(self.checked, self.source, LAW, reads, marks, self.request.sim, reads)

    def channel_map(self, layout: Layout, place: str) -> ChannelMap:
        return ChannelMap.find(
            layout, place, MARKS,
            lambda entry, checked: TaskMarksConfig.model_validate(entry, context=context(checked.models)),
            "when the task was shown", LAW,
        )  # fmt: skip

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return one.options.hand == other.options.hand

    def take(self, older: ChannelMap) -> ChannelMap:
        self._thresholds = kept(older.options.thresholds, self._thresholds)
        return replace(older, options=older.options.model_copy(update={"thresholds": self._thresholds}))

    def procedure(self, before: Sequence[Any]) -> Procedure:
        return Procedure(self._plan, bool(before))

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result:
        """The last time that it was shown counts."""
        joined = Samples(*(np.concatenate([getattr(p, k) for p in parts]) for k in ("times", "hand", "marks")))
        at = stretch_of(joined.marks, SHOWN)
        shown = joined.hand[at]
        path = path_of(joined.times[at], shown, channel_map.options.thresholds)
        arm, ranges = worn(channel_map.options), channel_map.options.ranges
        moved = TaskPath(path.points + np.array(channel_map.options.shift))
        Reach(moved, arm, ranges, ranges.posture).step(MOST * len(moved.points))
        return Result(channel_map, path, shown, date)

    def lines(self, result: Result) -> list[str]:
        who = f"person {result.channel_map.person}{' (simulated)' if result.channel_map.simulated else ''}"
        path = result.path
        return [
            f"{who}, {result.date.isoformat()}: the {result.channel_map.options.hand} showed "
            f"a path of {path.length:.2f} m in "
            f"{path.duration:.1f} s, at most {path.fastest:.2f} m/s; the arm reaches all of it"
        ]

    def metrics(self, result: Result) -> dict[str, Any]:
        path = result.path
        return {
            "person": result.channel_map.person, "date": result.date.isoformat(),
            "simulated": result.channel_map.simulated,
            "hand": result.channel_map.options.hand, "duration_s": path.duration, "length_m": path.length,
            "fastest_m_s": path.fastest, "points": len(path.points), "refusals": [],
        }  # fmt: skip

    def draw(self, result: Result, png: Path) -> None:
        figure, axes = plt.subplots(1, 2, figsize=(11, 5), constrained_layout=True)
        points, seen = result.path.points, result.shown[np.isfinite(result.shown).all(axis=1)]
        for view, (i, j), names in ((axes[0], (0, 1), "xy"), (axes[1], (2, 1), "zy")):
            view.plot(seen[:, i], seen[:, j], ".", color="0.75", markersize=3, label="the hand's samples")
            view.plot(points[:, i], points[:, j], color="#0072B2", label="the task")
            view.plot(*points[0, [i, j]], "o", color="#009E73", label="where it begins")
            view.set_xlabel(f"{names[0]}, m")
            view.set_ylabel(f"{names[1]}, m")
            view.set_aspect("equal", "datalim")
        axes[0].legend(fontsize=8)
        frame = result.channel_map.options.arms.arms.parent
        figure.suptitle(f"{self.lines(result)[0].partition(':')[0]}, frame {frame}", fontsize=11)
        save(figure, png)

    def record(self, result: Result) -> TaskRecord:
        options = result.channel_map.options
        return TaskRecord.model_validate(
            {
                "format": FORMAT, "person": options.person, "date": result.date,
                "simulated": result.channel_map.simulated,
                "frame": options.arms.arms.parent, "hand": options.hand, "thresholds": options.thresholds,
                "points": result.path.points.round(5).tolist(),
            }
        )  # fmt: skip


def worn(options: TaskMarksConfig) -> Worn:
    """The arm on the body that the options describe."""
    return Worn(options.figure, options.arm, options.envelope)


def _marks(person: str, thresholds: Thresholds, graph: Graph, entry: ControllerEntry) -> dict[str, Any]:
    """The entry of the marks' law: the law's own options, and where each joint's rotation and translation are."""
    own = {key: value for key, value in entry.options.items() if key not in ("task", "frame", "intention")}
    return {
        **own, "use": MARKS, "name": MARKS, "person": person, "teach": True, "button": True,
        "rotation": elements(graph, LAW, entry, "rotation"),
        "translation": elements(graph, LAW, entry, "translation"),
        "thresholds": thresholds.model_dump(),
    }  # fmt: skip
