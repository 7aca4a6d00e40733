"""The tracking experiment of Lisini Baldi et al. 2023 (III-B) on simulated wearers: IKNS against a gamepad.

Each wearer is calibrated, then follows T1, T2 and T3 three times each with the arm's null-space motion and with a
gamepad's trigger. The headline is the wearer who sees the curve ahead (preview); one who only reacts to the pointer's
error (pursuit) is the bound.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.ikns.curves import KINDS
from srl.studies.ikns.tracking_analysis import analysed, figure
from srl.studies.ikns.tracking_order import CONDITIONS, NAME, REPETITIONS, ordered
from srl.studies.ikns.tracking_person import session
from srl.studies.ikns.tracking_trial import PROFILE
from srl.studies.ikns.wearers import COUNT, Wearer, assumed, wearers
from srl.studies.result import Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

MODELS: Final = ("preview", "pursuit")
__all__ = ["run", "session", "study", "sweep"]
_QUICK: Final = 3  # wearers
_SWEPT: Final = 3  # wearers of the sweep
_UNCONCERNED: Final = {  # what a condition doesn't depend on
    "ikns": ("force_noise", "preload"),
    "gamepad": ("direction_error", "feedback", "marker_noise"),
}
_TRIES: Final = 2  # calibrations of a wearer


@dataclass(frozen=True)
class Calibrated:
    """A wearer with its calibration file's content; empty if it was refused twice. `refused`: the reasons."""

    wearer: Wearer
    content: str
    refused: tuple[str, ...]


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """The whole study; `quick`: three wearers, one repetition, preview alone."""
    if quick:
        return study(folder, runner, wearers(_QUICK), 1, MODELS[:1])
    return study(folder, runner, wearers(COUNT))


def study(
    folder: Path,
    runner: Runner,
    who: Sequence[Wearer],
    repetitions: int = REPETITIONS,
    models: Sequence[str] = MODELS,
) -> Result:
    """Runs the trials of these wearers and judges the claims. Rows: folder/MODEL/rows.parquet."""
    found = calibrated(who, folder, runner)
    ready = [one for one in found if one.content]
    rows = {}
    for model in models:
        tasks = [task for one in ready for task in trials(one, model, repetitions)]
        rows[model] = [plain(row) for row in runner.done(tasks, folder / model)]
    claims, table, statistics = analysed(rows, simulated=True)
    statistics["refused"] = {one.wearer.name: one.refused for one in found if one.refused}
    statistics["excluded"] = [one.wearer.name for one in found if not one.content]
    (folder / "statistics.json").write_text(json.dumps(statistics, indent=1) + "\n", encoding="utf-8")
    figure(rows[models[0]], folder / "curves.png", "simulated, " + models[0])
    files = ["curves.png", "statistics.json", *(f"{model}/rows.parquet" for model in models)]
    return Result(NAME, True, [one.number for one in who], claims, table, files)


def calibrated(who: Sequence[Wearer], folder: Path, runner: Runner) -> list[Calibrated]:
    """Calibrates each wearer, once more if it is refused, as a person would."""
    found = {one.name: Calibrated(one, "", ()) for one in who}
    for attempt in range(1, _TRIES + 1):
        left = [one for one in who if not found[one.name].content]
        tasks = [
            TrialTask.of(
                NAME, "ikns-wearer-calibration", 10_000 * attempt + one.number,
                {"person": one.name, "set": settings(one, "ikns", "preview"), "plan": {}}, profile=PROFILE,
            )
            for one in left
        ]  # fmt: skip
        if not tasks:
            break
        for one, row in zip(left, runner.rows(tasks, folder / f"calibration-{attempt}"), strict=True):
            before = found[one.name]
            reason = row.error or str(row.values["refused"])
            content = str(row.values.get("calibration", ""))
            found[one.name] = replace(before, content=content, refused=(*before.refused, *([reason] if reason else [])))
    return list(found.values())


def trials(one: Calibrated, model: str, repetitions: int = REPETITIONS) -> Iterator[TrialTask]:
    """A wearer's trials, in its own random order: which condition comes first, and the nine trials of each."""
    order = ordered([assumed()["seed"], one.wearer.number, 1], repetitions)
    for place, (condition, name, repetition) in enumerate(order, 1):
        yield task(one, condition, model, name, repetition, place)


def task(
    one: Calibrated, condition: str, model: str, name: str, repetition: int, place: int, **changed: Any
) -> TrialTask:
    """One trial. `changed`: a wearer's property, or `display`, `preload`, `gain_error`, `marker_noise`.

    Raises ValueError: there is no such property.
    """
    if unknown := [k for k in changed if not hasattr(one.wearer, k) and k not in assumed()]:
        raise ValueError(f"a wearer has no {', '.join(unknown)}")
    wearer = replace(one.wearer, **{k: v for k, v in changed.items() if hasattr(one.wearer, k)})
    a = {**assumed(), **changed}
    parameters = {
        "wearer": wearer.name, "condition": condition, "model": model, "curve": name, "repetition": repetition,
        "place": place, "set": settings(wearer, condition, model, a), "calibration": one.content,
        "display": a["display"], "tracking": wearer.tracking(model, a["gain_error"]),
        "trigger": {"noise": wearer.noise, "force_noise": wearer.force_noise, "preload": a["preload"]},
    }  # fmt: skip
    seed = 1000 * wearer.number + 100 * CONDITIONS.index(condition) + 10 * list(KINDS).index(name) + repetition
    return TrialTask.of(NAME, "ikns-tracking", seed, parameters, profile=PROFILE)


def settings(one: Wearer, condition: str, model: str, a: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """What is changed in the profile, by key path."""
    a = a or assumed()
    given = {"input": condition, **one.overrides(model, a["gain_error"])}
    return given if condition != "ikns" else given | {"sim.devices.mocap.noise": a["marker_noise"]}


def plain(row: Row) -> dict[str, Any]:
    """What the analysis needs of a row."""
    names = ("wearer", "condition", "model", "curve", "repetition", "place")
    return {name: row.task.parameters[name] for name in names} | row.values


def sweep(folder: Path, runner: Runner) -> list[dict[str, Any]]:
    """Changes one assumption at a time, for the first wearers; means of one trial a curve, preview.

    The wearers keep their calibrations. A factor multiplies a property of each wearer.
    """
    ready = [one for one in calibrated(wearers(_SWEPT), folder, runner) if one.content]
    asked = [(label, one) for label, changed, model in _changes() for one in swept(ready, changed, model)]
    # Where a change doesn't concern a condition, its trials are those without the change.
    unique = {one.identity: one for _, one in asked}
    rows = dict(zip(unique, runner.rows(list(unique.values()), folder / "sweep"), strict=True))
    found = []
    for label in dict.fromkeys(label for label, _ in asked):
        own = [rows[one.identity] for of, one in asked if of == label]
        values = [plain(row) for row in own if row.done]
        entry: dict[str, Any] = {"changed": label}
        for condition in CONDITIONS:
            for name in KINDS:
                chosen = [v["rmse"] for v in values if (v["condition"], v["curve"]) == (condition, name)]
                entry[f"{condition} {name}"] = float(np.mean(chosen))
        entry["difference"] = float(np.mean([entry[f"ikns {n}"] - entry[f"gamepad {n}"] for n in KINDS]))
        arm = [v for v in values if v["condition"] == "ikns"]
        entry["hand_p95_mm"] = 1e3 * max(v["hand_p95"] for v in arm)
        entry["hand_max_mm"] = 1e3 * max(v["hand_max"] for v in arm)
        found.append(entry)
    return found


def swept(ready: Sequence[Calibrated], changed: Mapping[str, Any], model: str) -> Iterator[TrialTask]:
    """One trial of each curve and condition. `changed`: by name a value, or a function of the wearer's own."""
    for one in ready:
        own = {k: v(getattr(one.wearer, k)) if callable(v) else v for k, v in changed.items()}
        for condition in CONDITIONS:
            concerns = {k: v for k, v in own.items() if k not in _UNCONCERNED[condition]}
            for name in KINDS:
                yield task(one, condition, model, name, 1, 0, **concerns)


def _changes() -> Iterator[tuple[str, dict[str, Any], str]]:
    """What is changed: in words; as in `swept`; the visual model."""

    def times(factor: float) -> Any:
        return lambda value: value * factor

    yield "nothing", {}, "preview"
    yield "pursuit", {}, "pursuit"
    for lag in (0.04, 0.2, 0.3):
        yield f"lag {lag} s", {"lag": lag}, "preview"
    yield "noise x 2", {"noise": times(2.0)}, "preview"
    yield "direction error x 2", {"direction_error": times(2.0)}, "preview"
    yield "direction error x 4", {"direction_error": times(4.0)}, "preview"
    yield "no feedback of the hand", {"feedback": 0.0}, "preview"
    yield "first gain off by 30 %", {"gain_error": 0.3}, "preview"
    yield "no correction by sight", {"correction": 0.0}, "preview"
    yield "display 0.1 s late", {"display": 0.12}, "preview"
    yield "markers' noise 2 mm", {"marker_noise": 0.002}, "preview"
    yield "finger's force noise x 0.5", {"force_noise": times(0.5)}, "preview"
    yield "finger's force noise x 2", {"force_noise": times(2.0)}, "preview"
    yield "trigger's preload 0.2", {"preload": 0.2}, "preview"
