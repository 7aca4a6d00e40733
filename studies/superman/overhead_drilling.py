"""Overhead drilling: a 5 kg drill is held in 20 holes overhead, with Kairos and by the person alone (Table II)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from srl.studies.result import Result
from srl.studies.superman import user_study
from srl.studies.superman.assumptions import assumed as assumptions
from srl.studies.superman.drilling_trial import PROFILES, STUDY
from srl.studies.superman.persons import COUNT, assumed, persons
from srl.studies.superman.published import CONDITIONS, HOLES, PRINTED_II, TABLE_II
from srl.studies.superman.user_trial import MUSCLES
from srl.studies.tasks.runner import Runner
from srl.studies.toolkit.trials import Trial, table

TRIAL: Final = "superman-drilling"
MEASURES: Final = {m.name: (m.unit, m.meaning) for m in TABLE_II.measures}
_QUICK: Final = 2  # persons
_STAY: Final = 5.0  # s in each hole


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs the study. `quick`: two persons, a few holes."""
    people, a = persons(_QUICK if quick else COUNT), assumptions(STUDY)
    holes = {"HR": a["robot_holes"], "H": HOLES}
    if quick:
        holes = dict.fromkeys(CONDITIONS, a["quick_holes"])
    asked = user_study.tasks(STUDY, TRIAL, PROFILES, people, holes=holes)
    return result(user_study.trials(runner, asked, folder / "trials"), folder)


def result(found: list[Trial], folder: Path) -> Result:
    """Makes tables, pictures and claims from trials of both conditions.

    Holes and touches of a trial of fewer holes count by their share of all. Who completed no hole has no time for each,
    and is left out of the times only.
    """
    drilled = ", ".join(sorted({f"{t.condition} {t.values['tried']:.0f}" for t in found}))
    found = [_of_all(t) for t in found]
    count, errors, time = (user_study.paired(found, name) for name in ("N_Hl", "N_err", "T"))
    counted = [t for t in found if t.subject not in count.out]
    timed = [t for t in found if t.subject not in time.out]
    files: list[str] = []
    lines = []
    if counted:
        counts = table("Overhead drilling, simulated", counted, CONDITIONS, {n: MEASURES[n] for n in ("N_Hl", "N_err")})
        files += user_study.pictures(counts, folder, "Overhead drilling")
        lines = user_study.rows(counts, PRINTED_II, ("off_mm", "missed", "gave_up", *MUSCLES), counted)
        files.append(user_study.muscles(counted, folder, "Overhead drilling"))
    if timed:
        times = table("Overhead drilling, simulated", timed, CONDITIONS, {"T": MEASURES["T"]})
        files += user_study.pictures(times, folder, "Overhead drilling")
        beside = {row["subject"]: row for row in user_study.rows(times, PRINTED_II, (), timed)}
        lines = [row | {f"T {c}": beside.get(row["subject"], {}).get(f"T {c}") for c in CONDITIONS} for row in lines]
    moving = user_study.paired([_moving(t) for t in found], "moving")
    h, hr = (PRINTED_II["T"].metrics[c][0] - _STAY for c in ("H", "HR"))
    ratio = f"; without the 5 s of each stay {moving.ratio} times as long (paper: {hr / h:.2f})"
    return Result(
        STUDY,
        simulated=True,
        seeds=[assumed()["seed"]],
        claims=[
            count.claim(
                "robot-more-holes", f"more holes with the robot, of {HOLES} (drilled: {drilled})",
                "20 (0) against 13 (4.93), p < 0.01",
                "holes", more=True,
            ),
            errors.claim(
                "robot-fewer-errors", "fewer touches with the robot",
                "0.42 (0.51) against 2.17 (2.82), p < 0.01 (its rows give p = 0.29)", "errors", more=False,
            ),
            time.claim(
                "robot-slower", f"more time for each hole with the robot{ratio}",
                "10.04 (1.15) s against 7.68 (0.53) s, p < 0.001", "s", more=True,
            ),
        ],
        table=lines,
        files=files,
    )  # fmt: skip


def _of_all(trial: Trial) -> Trial:
    """The trial with its counts as if all holes had gone like those that were tried."""
    share = trial.values["tried"] / HOLES
    counts = {name: trial.values[name] / share for name in ("N_Hl", "N_err")}
    return Trial(trial.subject, trial.condition, {**trial.values, **counts}, trial.place)


def _moving(trial: Trial) -> Trial:
    """The trial with the time for each hole that isn't spent in it."""
    time = trial.values["T"]
    return Trial(trial.subject, trial.condition, {**trial.values, "moving": time - _STAY if time else math.nan})
