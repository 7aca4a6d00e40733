"""Prolonged manipulation: a ring is led along a bent wire and back, with MOCA and by the person alone (Table I)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from srl.studies.result import Result
from srl.studies.superman import user_study
from srl.studies.superman.persons import COUNT, assumed, persons
from srl.studies.superman.published import CONDITIONS, PRINTED_I, TABLE_I
from srl.studies.superman.user_trial import MUSCLES
from srl.studies.superman.wire_trial import PROFILE, STUDY
from srl.studies.tasks.runner import Runner
from srl.studies.toolkit.trials import Trial, table

TRIAL: Final = "superman-wire"
MEASURES: Final = {m.name: (m.unit, m.meaning) for m in TABLE_I.measures}
_QUICK: Final = 2  # persons
_PAUSES: Final = 60.0  # s, of the paper's trials, if it had as many as ours; it doesn't give their number


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs the study. `quick`: two persons, without the pauses."""
    people = persons(_QUICK if quick else COUNT)
    given: dict[str, Any] = {"changed": {"marks": []}} if quick else {}
    asked = user_study.tasks(STUDY, TRIAL, dict.fromkeys(CONDITIONS, PROFILE), people, **given)
    return result(user_study.trials(runner, asked, folder / "trials"), folder)


def result(found: list[Trial], folder: Path) -> Result:
    """Makes table, pictures and claims from trials of both conditions.

    Where a robot stopped, or a person gave up, there is no time: the person counts in the touches only.
    """
    seeds = [assumed()["seed"]]
    touches = user_study.paired(found, "N_err")
    seconds = user_study.paired(found, "T", finished=True)
    moving = user_study.paired(found, "moving", finished=True)
    whole = [t for t in found if t.subject not in seconds.out]
    lines, files = [], [user_study.muscles(whole, folder, "Wire path")] if whole else []
    if whole:
        got = table("Prolonged manipulation, simulated", whole, CONDITIONS, MEASURES)
        files = [*user_study.pictures(got, folder, "Wire path"), *files]
        lines = user_study.rows(got, PRINTED_I, ("moving", "off_mm", "missed", *MUSCLES), whole)
    h, hr = (PRINTED_I["T"].metrics[c][0] - _PAUSES for c in ("H", "HR"))
    ratio = f"; without the pauses {moving.ratio} times as long (paper: {hr / h:.2f}, if it had six pauses)"
    slower = seconds.claim(
        "robot-slower", f"slower with the robot{ratio}", "180.75 (23.25) s against 129.58 (11.64) s, p < 0.001", "s",
        more=True,
    )  # fmt: skip
    fewer = touches.claim(
        "robot-fewer-errors", "fewer touches with the robot than alone",
        "0.58 (0.79) against 1.25 (1.48), not significant", "errors", more=False,
    )  # fmt: skip
    return Result(STUDY, simulated=True, seeds=seeds, claims=[fewer, slower], table=lines, files=files)
