"""The grasping experiment of Lisini Baldi et al. 2023 (III-C) on simulated wearers: IKNS against a ring.

Each wearer picks, lifts, places and releases each of the eleven objects, with the finger driven by the own null-space
motion and by a ring on the other hand.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns.grasp_table import WEAK
from srl.studies.ikns.grasping_analysis import analysed, counted
from srl.studies.ikns.grasping_person import NAME, QUICK, session
from srl.studies.ikns.grasping_trial import AIM, OPTIONS, PROFILE
from srl.studies.ikns.grasping_wearer import KINDS
from srl.studies.ikns.tracking import Calibrated, calibrated
from srl.studies.ikns.wearers import Wearer, assumed, wearers
from srl.studies.result import Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

__all__ = ["NAME", "run", "session", "sweep"]

COUNT: Final = 50
"""Wearers of the whole study."""
_QUICK: Final = 2  # wearers
_SWEPT: Final = 4  # wearers of the sweep


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """The whole study; `quick`: two wearers, two objects."""
    if quick:
        return study(folder, runner, wearers(_QUICK), QUICK)
    return study(folder, runner, wearers(COUNT))


def study(folder: Path, runner: Runner, who: Sequence[Wearer], codes: Sequence[str] = tuple(YCB)) -> Result:
    """Runs the trials of these wearers with these objects and judges the claims. Rows: folder/trials/rows.parquet."""
    found = calibrated(who, folder, runner)
    tasks = [task for one in found if one.content for task in trials(one, codes)]
    rows = [plain(row) for row in runner.done(tasks, folder / "trials")]
    claims, table, statistics = analysed(rows)
    statistics["refused"] = {one.wearer.name: one.refused for one in found if one.refused}
    statistics["excluded"] = [one.wearer.name for one in found if not one.content]
    (folder / "statistics.json").write_text(json.dumps(statistics, indent=1) + "\n", encoding="utf-8")
    return Result(
        NAME, True, [one.number for one in who], claims, table, ["statistics.json", "trials/rows.parquet"]
    )  # fmt: skip


def trials(one: Calibrated, codes: Sequence[str]) -> Iterator[TrialTask]:
    """A wearer's trials, in its own random order. Both conditions have the same errors of reaching."""
    order = np.random.default_rng([assumed()["seed"], one.wearer.number, 2])
    for condition in order.permutation(list(KINDS)).tolist():
        for code in order.permutation(list(codes)).tolist():
            yield task(one, condition, code)


def task(one: Calibrated, condition: str, code: str, **changed: Any) -> TrialTask:
    """One trial. `changed`: a wearer's property, or one of `grasping_trial.OPTIONS`.

    Raises ValueError: there is no such one.
    """
    own = {field.name for field in fields(Wearer)} & changed.keys()
    if unknown := [name for name in changed if name not in own and name not in OPTIONS]:
        raise ValueError(f"neither a wearer nor a trial has {', '.join(unknown)}; a trial has {', '.join(OPTIONS)}")
    wearer = replace(one.wearer, **{name: changed[name] for name in own})
    a = assumed()
    options = wearer.overrides("preview", a["gain_error"])
    if condition == "ikns":
        options["sim.devices.mocap.noise"] = a["marker_noise"]
    parameters = {
        "wearer": wearer.name, "condition": condition, "object": code, "set": options, "calibration": one.content,
        **{name: value for name, value in changed.items() if name not in own},
    }  # fmt: skip
    seed = 100 * wearer.number + list(YCB).index(code)
    return TrialTask.of(NAME, NAME, seed, parameters, profile=PROFILE)


def plain(row: Row) -> dict[str, Any]:
    """What the analysis needs of a row."""
    return {name: row.task.parameters[name] for name in ("wearer", "condition", "object")} | row.values


def sweep(folder: Path, runner: Runner) -> list[dict[str, Any]]:
    """Changes one assumption at a time, for the first wearers and all objects, IKNS alone."""
    ready = [one for one in calibrated(wearers(_SWEPT), folder, runner) if one.content]
    asked = {
        label: [swept(one, condition, code, change) for one in ready for code in YCB]
        for label, condition, change in changes()
    }
    rows = runner.by_label(asked, folder / "sweep")
    return [{"changed": label} | counted([plain(row) for row in own]) for label, own in rows.items()]


def changes() -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """What is changed: in words; the condition; by name, a value or a function of wearer and object."""

    def times(name: str, factor: float) -> Any:
        return lambda wearer, code: getattr(wearer, name) * factor

    yield "nothing", "ikns", {}
    yield "ring", "ring", {}
    for share in (0.7, 1.3):
        yield (
            f"friction of the pads x {share}",
            "ikns",
            {"thing": lambda wearer, code, share=share: {"friction": share * YCB[code].friction}},
        )
    for skin in (0.40, 0.84):
        yield f"friction of the skin {skin}", "ikns", {"skin": skin}
    yield f"servos of {WEAK['stall_torque']} N m", "ikns", {"servo": WEAK}
    for aim in (0.0, 2 * AIM, 3 * AIM):
        yield f"aim {1e3 * aim:.0f} mm instead of {1e3 * AIM:.0f}", "ikns", {"aim": aim}
    for factor in (0.5, 2.0):
        yield f"swivel's speed x {factor:g}", "ikns", {"pace": times("pace", factor)}
    yield "reaction + 0.2 s", "ikns", {"reaction": lambda wearer, code: wearer.reaction + 0.2}
    yield "noise x 2", "ikns", {"noise": times("noise", 2.0)}
    yield "direction error x 3", "ikns", {"direction_error": times("direction_error", 3.0)}
    yield "no feedback of the hand", "ikns", {"feedback": 0.0}
    yield "closes with the elbow outwards", "ikns", {"outwards": True}


def swept(one: Calibrated, condition: str, code: str, change: Mapping[str, Any]) -> TrialTask:
    """One trial of the sweep."""
    own = {name: value(one.wearer, code) if callable(value) else value for name, value in change.items()}
    return task(one, condition, code, **own)
