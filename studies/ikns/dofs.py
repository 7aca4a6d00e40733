"""Two and three degrees of freedom (DoFs) from one null space, on simulated wearers: what one would give a person.

Beyond Lisini Baldi et al. 2023, who have one and name more as future work. Each wearer is calibrated for swivel and
shrug, for swivel and protraction, and for all three; then cross-talk, noise, leakage and tracking are measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import permutations
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.ikns.columns import mean, most
from srl.studies.ikns.wearers import assumed, wearers
from srl.studies.result import Claim, Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

STUDY: Final = "ikns-dofs"
PROFILE: Final = "ikns-two"
SETS: Final = {
    "swivel+shrug": ("swivel", "shrug"),
    "swivel+protraction": ("swivel", "protraction"),
    "all three": ("swivel", "shrug", "protraction"),
}
WEARERS: Final = 3
_ONE: Final = (("T1", "hold"), ("hold", "T3"))  # one target moves, the other DoF is to stay in the middle
_BOTH: Final = ("T1", "T3")
_LINEAR, _APART, _STILL = 0.05, 1.0, 20.0  # share of the range; points of RMSE; mm


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs all trials; `quick`: one wearer and one pair."""
    count = 1 if quick else WEARERS
    made = runner.rows(_calibrations(count), folder / "calibrations")
    names = list(SETS)[:1] if quick else list(SETS)
    rows = runner.rows(
        [task for row in made for name in names if _usable(row, name) for task in _trials(row, name)], folder
    )
    table = [line for name in names for line in _lines(name, made, rows)]
    return Result(STUDY, True, [row.task.seed for row in made], claims=_claims(names, made, rows), table=table)


def _calibrations(count: int) -> list[TrialTask]:
    noise = {"sim.devices.mocap": {"noise": assumed()["marker_noise"]}}
    found = []
    for one in wearers(count):
        given = {"set": one.overrides("preview", assumed()["gain_error"]) | noise, "sets": SETS, "wearer": one.name}
        found.append(TrialTask.of(STUDY, "ikns-dofs-calibration", one.number, given, profile=PROFILE))
    return found


def _trials(row: Row, name: str) -> Iterable[TrialTask]:
    """What a wearer does with a set's calibration; its seeds aren't the calibration's."""
    given = {
        "set": row.task.parameters["set"], "wearer": row.task.parameters["wearer"], "name": name, "dofs": SETS[name],
        "calibration": row.values[f"{name}.calibration"], "display": assumed()["display"],
    }  # fmt: skip
    seed, k = 1000 + row.task.seed, len(SETS[name])
    yield TrialTask.of(STUDY, "ikns-dofs-noise", seed, given, profile=PROFILE)
    for where in ("points", "between") if k == 2 else ("between",):
        yield TrialTask.of(STUDY, "ikns-dofs-crosstalk", seed, given | {"where": where}, profile=PROFILE)
    for targets in (_BOTH, *_ONE) if k == 2 else ((*_BOTH, "hold"),):
        yield TrialTask.of(STUDY, "ikns-dofs-tracking", seed, given | {"targets": targets}, profile=PROFILE)


def _usable(row: Row, name: str) -> bool:
    return row.done and not row.values[f"{name}.refused"]


def _of(rows: Iterable[Row], name: str, trial: str, **parameters: Any) -> list[Mapping[str, Any]]:
    """The values of a set's trials of one kind."""
    return [
        row.values
        for row in rows
        if row.done and row.task.parameters["name"] == name and row.task.trial == f"{STUDY}-{trial}"
        and all(row.task.parameters.get(key) == value for key, value in parameters.items())
    ]  # fmt: skip


def _lines(name: str, made: list[Row], rows: list[Row]) -> Iterable[dict[str, Any]]:
    """A row of the table for each DoF of a set: means over the wearers."""
    dofs = SETS[name]
    calibrations: list[Mapping[str, Any]] = [row.values for row in made if _usable(row, name)]
    targets = [*_BOTH, "hold"][: len(dofs)]
    both = _of(rows, name, "tracking", targets=targets)
    again, between = (_of(rows, name, "crosstalk", where=where) for where in ("points", "between"))
    for j, dof in enumerate(dofs):
        others = [other for other in dofs if other != dof]
        alone = _of(rows, name, "tracking", targets=list(_ONE[j])) if len(dofs) == 2 else []
        yield {
            "set": name,
            "dof": dof,
            "wearers": len(calibrations),
            "refused": len(made) - len(calibrations),
            "range deg": mean(calibrations, f"range_{dof}"),
            # How much of this DoF's range moves when another moves: the worse of the others.
            "in sample": _worst(calibrations, f"{name}.span", dof, others),
            "again": _worst(again, "linear", dof, others),
            "between": _worst(between, "linear", dof, others),
            "between, span": _worst(between, "span", dof, others),
            "c per mm": mean(_of(rows, name, "noise"), f"noise_{dof}"),
            "leak rms mm": 1e3 * mean(between, f"leak_rms_{dof}"),
            "leak max mm": 1e3 * most(between, f"leak_max_{dof}"),
            "target": targets[j],
            "rmse alone": mean(alone, f"rmse_{dof}"),
            "rmse at once": mean(both, f"rmse_{dof}"),
            "leak at once, max mm": 1e3 * most(both, "leak_max"),
        }


def _claims(names: list[str], made: list[Row], rows: list[Row]) -> list[Claim]:
    """Ours: the paper has one DoF."""
    spans = [
        row.values[f"{name}.span_{a}_{b}"]
        for row in made
        for name in names
        if _usable(row, name)
        for a, b in permutations(SETS[name], 2)
    ]
    pairs = [name for name in names if len(SETS[name]) == 2]
    worse = [
        mean(_of(rows, name, "tracking", targets=list(_BOTH)), f"rmse_{dof}")
        - mean(_of(rows, name, "tracking", targets=list(_ONE[j])), f"rmse_{dof}")
        for name in pairs
        for j, dof in enumerate(SETS[name])
    ]
    leak = 1e3 * max(most(_of(rows, name, "tracking", targets=list(_BOTH)), "leak_max") for name in pairs)
    at_most = float(np.max(np.array(spans, dtype=float))) if spans else float("nan")
    apart = float(np.max(worse))
    return [
        Claim(
            id="crosstalk-in-sample", text=f"in the calibration's own trials a DoF moves another by at most {_LINEAR}",
            paper="", measured=at_most, unit="", holds=at_most <= _LINEAR,
        ),
        Claim(
            id="two-at-once", text=f"a second target costs less than {_APART:g} point of RMSE, any DoF of any pair",
            paper="", measured=apart, unit="% of range", holds=apart < _APART,
        ),
        Claim(
            id="hand-still",
            text=f"the hand leaves its place by less than {_STILL:g} mm while two targets are followed",
            paper="", measured=leak, unit="mm", holds=leak < _STILL,
        ),
    ]  # fmt: skip


def _worst(found: list[Mapping[str, Any]], what: str, dof: str, others: list[str]) -> float:
    return float(np.max([mean(found, f"{what}_{dof}_{other}") for other in others]))
