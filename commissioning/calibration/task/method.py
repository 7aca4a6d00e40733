"""How a task for `independent-operation` is shown: the hand does it once, and the path is checked and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from srl.commissioning.calibration.marks import Indices, stretch_of
from srl.commissioning.calibration.method import FittedMethod
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.profile_subset import elements, subset_for
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.suit.channel_map import SuitChannelMap
from srl.commissioning.calibration.task.procedure import Plan, Procedure
from srl.commissioning.calibration.task.samples import SHOWN, Samples, TaskMarksConfig
from srl.control.operation.demonstration import TaskError, TaskPath, Thresholds, path_of
from srl.control.operation.reach import MOST, Reach
from srl.control.operation.record import FORMAT, TaskRecord
from srl.control.operation.worn import Worn
from srl.runtime.contracts.signals import Array
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "independent-operation"


@dataclass(frozen=True)
class ChannelMap(SuitChannelMap):
    """What is read of a suit whose wearer shows a path."""

    law, config, unknown = "task-marks", TaskMarksConfig, "when the task was shown"

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        rotation, translation = self.poses(floats)
        hand = np.full((len(floats), 3), np.nan)
        arm = worn(self.options)
        good = np.isfinite(rotation).all(axis=(1, 2)) & np.isfinite(translation).all(axis=(1, 2))
        for i in np.flatnonzero(good):
            arm.see(rotation[i], translation[i], 0.0)
            hand[i] = arm.place(self.options.hand)
        return Samples(times, hand, marks)


@dataclass(frozen=True)
class Shown:
    """A path, and the hand's samples (k, 3) m that it is from."""

    path: TaskPath
    hand: Array


class TaskMethod(FittedMethod[ChannelMap, Shown]):
    """See the module's docstring."""

    law, option, record_type, error, channels = LAW, "task", TaskRecord, TaskError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    thing = "tasks"
    counted = range(SHOWN, SHOWN + 1)

    def subset(self, person: str) -> tuple[Profile, Source]:
        reads = ("rotation", "translation")
        marks = partial(self._marks, person)
        return subset_for(self.checked, self.source, LAW, reads, marks, self.request.sim, reads)

    def _marks(self, person: str, graph: Graph, entry: ControllerEntry) -> dict[str, Any]:
        """The entry of the marks' law: the law's own options, and where each joint's rotation and translation are."""
        own = {key: value for key, value in entry.options.items() if key not in ("task", "frame", "intention")}
        poses = {port: elements(graph, LAW, entry, port) for port in ("rotation", "translation")}
        return self._entry(**own | poses | {"person": person, "teach": True, "button": True})

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return one.options.hand == other.options.hand

    def procedure(self, before: Sequence[Any]) -> Procedure:
        return Procedure(self._plan, bool(before))

    def _fit(self, channel_map: ChannelMap, samples: Samples) -> tuple[Shown, tuple[TaskError, ...]]:
        """The last time that it was shown counts. A path that can't be used isn't computed, so nothing is refused."""
        options, at = channel_map.options, stretch_of(samples.marks, SHOWN)
        path = path_of(samples.times[at], samples.hand[at], options.thresholds)
        moved = TaskPath(path.points + np.array(options.shift))
        Reach(moved, worn(options), options.ranges, options.ranges.posture).step(MOST * len(moved.points))
        return Shown(path, samples.hand[at]), ()

    def lines(self, result: Result[Shown]) -> list[str]:
        path = result.found.path
        return [
            f"person {result.person}{result.when}: the {result.options.hand} showed a path of {path.length:.2f} m in "
            f"{path.duration:.1f} s, at most {path.fastest:.2f} m/s; the arm reaches all of it"
        ]

    def _figures(self, result: Result[Shown]) -> dict[str, Any]:
        path = result.found.path
        return {
            "hand": result.options.hand, "duration_s": path.duration, "length_m": path.length,
            "fastest_m_s": path.fastest, "points": len(path.points),
        }  # fmt: skip

    def draw(self, result: Result[Shown], png: Path) -> None:
        figure, axes = plt.subplots(1, 2, figsize=(11, 5), constrained_layout=True)
        points, hand = result.found.path.points, result.found.hand
        seen = hand[np.isfinite(hand).all(axis=1)]
        for view, (i, j), names in ((axes[0], (0, 1), "xy"), (axes[1], (2, 1), "zy")):
            view.plot(seen[:, i], seen[:, j], ".", color="0.75", markersize=3, label="the hand's samples")
            view.plot(points[:, i], points[:, j], color="#0072B2", label="the task")
            view.plot(*points[0, [i, j]], "o", color="#009E73", label="where it begins")
            view.set_xlabel(f"{names[0]}, m")
            view.set_ylabel(f"{names[1]}, m")
            view.set_aspect("equal", "datalim")
        axes[0].legend(fontsize=8)
        frame = result.options.arms.arms.parent
        figure.suptitle(f"{self.lines(result)[0].partition(':')[0]}, frame {frame}", fontsize=11)
        save(figure, png)

    def _content(self, result: Result[Shown]) -> dict[str, Any]:
        options = result.options
        return {
            "format": FORMAT, "frame": options.arms.arms.parent, "hand": options.hand,
            "thresholds": options.thresholds, "points": result.found.path.points.round(5).tolist(),
        }  # fmt: skip


def worn(options: TaskMarksConfig) -> Worn:
    """The arm on the body that the options describe."""
    return Worn(options.figure, options.arm, options.envelope)
