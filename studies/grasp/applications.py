"""Lifting what is too large for a hand, and opening a bottle with one hand (Prattichizzo et al. 2014, IV-C).

Arms on the same seeds: the bare hand, the published mapping, a finger that is frozen where it begins (a splint), and
the law that does better. In each scene each begins in the pose that a search found best for it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.grasp import bottle_trial, door_trial, lifting_trial, starts
from srl.studies.grasp.applications_analysis import Asked, compared, records, table, verdicts
from srl.studies.grasp.applications_scenes import write
from srl.studies.grasp.things import Thing
from srl.studies.result import Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask

STUDY: Final = "grasp-applications"
STARTS: Final = "grasp-starts"
PROFILE: Final = "sixth-finger"
SCENES: Final = ("box", "die", "mixed", "near", "bottle", "door")
LAW: Final = "concentric"
"""The law that is held against the splint; chosen on other seeds, before the study ran."""
STUDIED: Final = ("bare", "mapping", "as-published", "splint", LAW)
SEEDS: Final = 50
_QUICK: Final = (("box",), 2)
_SWEPT: Final = ("scaling", "partial")  # further candidates
_SWEPT_SEEDS: Final = range(20_000, 20_012)  # neither the study's nor the search's
_SANITY: Final = "can"
_MISSED: Final = (0.030, 15.0)  # m along the palm, farther from the finger; degrees of each flexion; ours
_TRIALS: Final = {"bottle": bottle_trial.TRIAL, "door": door_trial.TRIAL}  # the others are lifts
_PLAYS: Final = {"bottle": bottle_trial.unscrew, "door": door_trial.press}
_PAPER: Final = {
    "box": "a box that one hand can't grasp is grasped (Fig. 6a)",
    "die": "a die that one hand can't grasp is grasped (Fig. 6b)",
    "door": "a door is opened by a full hand (Fig. 7b)",
    "bottle": "the bottle is held while its cap is unscrewed (Fig. 7a)",
}


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """The whole study; `quick`: the box on two seeds."""
    scenes, count = _QUICK if quick else (SCENES, SEEDS)
    tasks = [*trials(scenes, STUDIED, range(count)), *trials([_SANITY], ["bare"], range(2 if quick else 10))]
    found = records(runner.rows(tasks, folder))
    asked = [Asked(scene, scene, "mapping", "bare", _PAPER[scene]) for scene in scenes if scene in _PAPER]
    asked += [Asked(f"{scene}-splint", scene, LAW, "splint", "") for scene in scenes]
    pairs = [
        compared(found, scene, arm, other)
        for scene in scenes
        for arm, other in (
            ("mapping", "bare"),
            ("splint", "bare"),
            ("mapping", "splint"),
            (LAW, "splint"),
            (LAW, "mapping"),
        )
    ]
    (folder / "pairs.json").write_text(json.dumps(pairs, indent=1) + "\n", encoding="utf-8")
    files = ["pairs.json", "rows.parquet"]
    for scene in scenes:
        for arm in ("mapping", LAW):
            (one,) = trials([scene], [arm], [0])
            files += write(folder, f"{scene}-{arm}", _PLAYS.get(scene, lifting_trial.lift), one.text, one.parameters, 0)
    return Result(STUDY, True, list(range(count)), verdicts(found, asked), table(found), files)


def trials(scenes: Iterable[str], arms: Sequence[str], seeds: Iterable[int]) -> Iterator[TrialTask]:
    """The trials of arms in scenes, each from its start."""
    kept = list(seeds)
    for scene in scenes:
        for arm in arms:
            for seed in kept:
                yield task(scene, arm, _start(scene, arm, seed), seed)


def _start(scene: str, arm: str, seed: int) -> dict[str, Any]:
    """As found; in `near` it is missed by what a person who puts the finger on anew may miss it by."""
    found = starts.found(scene, arm)
    if scene == "near":
        rng = np.random.default_rng([seed, 17])
        found["distal"] = round(found["distal"] + rng.uniform(0.0, _MISSED[0]), 4)
        off = [0.0, *rng.uniform(-_MISSED[1], _MISSED[1], 3)]
        found["home"] = [round(angle + error, 1) for angle, error in zip(found["home"], off, strict=True)]
    return found


def task(scene: str, arm: str, start: dict[str, Any], seed: int, **more: Any) -> TrialTask:
    """One trial. `start`: `distal` and `home`; `more`: of the trial's parameters."""
    trial = _TRIALS.get(scene, lifting_trial.TRIAL)
    return TrialTask.of(STUDY, trial, seed, {"scene": scene, "arm": arm, **start, **more}, profile=PROFILE)


def sweep(folder: Path, runner: Runner) -> list[dict[str, Any]]:
    """Further laws from the same starts, on seeds of their own."""
    tasks = [*trials(SCENES, [*STUDIED, *_SWEPT], _SWEPT_SEEDS)]
    return table(records(runner.rows(tasks, folder / "sweep")))


def search(folder: Path, quick: bool, runner: Runner) -> Result:
    """Searches the start of each arm in each scene, as those in `starts.FILE` were; `quick`: the door's splint."""
    found: dict[str, dict[str, Any]] = {}
    for scene in ("door",) if quick else (*SCENES, _SANITY):
        for arm in ("splint",) if quick else ("bare",) if scene == _SANITY else STUDIED:
            if scene != "near":  # which misses the box's
                found.setdefault(scene, {})[arm] = starts.search(
                    _poses(scene, arm), partial(_tried, scene, arm), runner, folder / f"{scene}-{arm}"
                )
    if "box" in found:
        found["near"] = found["box"]
    (folder / starts.FILE.name).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    lines = [{"scene": scene, "arm": arm, **best} for scene, arms in found.items() for arm, best in arms.items()]
    return Result(STARTS, True, [starts.SEEDS], [], lines, [starts.FILE.name])


def _tried(scene: str, arm: str, pose: Mapping[str, Any], seed: int) -> TrialTask:
    """A trial of the search, shorter where a shorter one says nearly the same."""
    short = {"hold": 1.0} if scene in lifting_trial.LOADS else {}
    return task(scene, arm, dict(pose), seed, **short)


def _poses(scene: str, arm: str) -> list[dict[str, Any]]:
    """What is tried."""
    if scene == "door":
        return door_trial.poses()
    if arm == "bare":
        return [{"distal": distal, "home": [0.0, -60.0, 0.0, 0.0]} for distal in starts.BARE]
    if scene == "bottle":
        thing = Thing("cylinder", bottle_trial.DIAMETER)
    else:
        load = lifting_trial.LOADS[scene]
        thing = Thing(load.shape, load.size)
    return starts.candidates(thing, starts.ROUNDS[0][0], 0)
