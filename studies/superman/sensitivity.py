"""Which claims of the SUPER-MAN studies hinge on which parameter of the person or the task.

Points spread evenly over wide ranges (Sobol's sequence) each do all four tasks in a shorter form. What a claim compares
has a rank correlation with each parameter; and the claim holds at so many points of a parameter's lower and upper half.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.gravity import GRAVITY
from srl.studies.result import Result
from srl.studies.superman import load_carrying, load_trial, peg_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.sensitivity_design import NAMES, STUDY, Point, points, tasks
from srl.studies.tasks.runner import Runner

Rows = Mapping[str, Mapping[str, Any]]  # of one point, by name of the trial
Margin = Callable[[Rows, Mapping[str, Any]], float]
LEVEL: Final = 0.05  # of all correlations of a claim together (Bonferroni)


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs all points; `quick`: the first two."""
    a = assumed(STUDY)
    chosen = points(a["quick_points"] if quick else a["points"])
    rows = runner.rows(tasks(chosen), folder / "trials")
    found = [
        {name: row.values for name, row in zip(NAMES, rows[k : k + len(NAMES)], strict=True) if row.done}
        for k in range(0, len(rows), len(NAMES))
    ]
    result = Result(STUDY, simulated=True, seeds=[a["seed"]])
    result.table, shown = analysed(chosen, found)
    if shown:
        draw(folder / "sensitivity.png", shown, list(chosen[0].values))
        result.files = ["sensitivity.png"]
    return result


# -- what each claim compares: it holds where that is above 0; NaN where it couldn't be measured


def _peg(label: str, above: bool) -> Margin:
    """N from the payload, above or below it; no more than 0 if the peg isn't in and out, or the robot not stopped."""

    def margin(rows: Rows, a: Mapping[str, Any]) -> float:
        row, condition = rows[f"peg {label}"], peg_trial.CONDITIONS[label]
        line = GRAVITY * a["peg-in-hole"][f"payload_{condition.robot}"]
        if above:
            far = row["force"] - line
            return far if row["stop"] == "device fault" else min(far, 0.0)
        far = line - row["force"]
        return far if row["withdrew"] else min(far, 0.0)

    return margin


def _inserts(rows: Rows, a: Mapping[str, Any]) -> float:
    return 1.0 if rows[f"peg {peg_trial.MOCA.label}"]["withdrew"] else 0.0


def _light(rows: Rows, a: Mapping[str, Any]) -> float:
    return GRAVITY * a["peg-in-hole"]["payload_moca"] - float(rows[f"peg {peg_trial.MOCA.label}"]["force"])


def _finished(rows: Rows, study: str, measure: str) -> tuple[float, float]:
    """A measure under HR and H; NaN if it wasn't finished."""
    hr, h = rows[f"{study} HR"], rows[f"{study} H"]
    if not (hr["finished"] and h["finished"]):
        return math.nan, math.nan
    return float(hr[measure]), float(h[measure])


def _slower(rows: Rows, a: Mapping[str, Any]) -> float:
    hr, h = _finished(rows, "wire", "moving")
    return hr / h - 1.0


def _fewer(rows: Rows, a: Mapping[str, Any]) -> float:
    hr, h = _finished(rows, "wire", "N_err")
    return h - hr


def _each(name: str, sign: float) -> Margin:
    """Of drilling: a measure a hole of those tried, H less HR with the sign -1."""

    def margin(rows: Rows, a: Mapping[str, Any]) -> float:
        s = a[STUDY]
        hr, h = rows["drilling HR"][name], rows["drilling H"][name]
        if hr is None or h is None:
            return math.nan
        return sign * (hr / s["robot_holes"] - h / s["holes"])

    return margin


def _hole_slower(rows: Rows, a: Mapping[str, Any]) -> float:
    hr, h = rows["drilling HR"]["T"], rows["drilling H"]["T"]
    return math.nan if hr is None or h is None else hr - h


def _carried(rows: Rows, a: Mapping[str, Any]) -> float:
    short = load_trial.shortened(a["load-carrying"])
    row = rows["load"]
    far = short["tolerance"] - float(row["off"])
    return far if load_carrying.carried(row, short) else min(far, 0.0)


def _force(rows: Rows, a: Mapping[str, Any]) -> float:
    setup, force = a["load-carrying"], rows["load"]["force_z"]
    return math.nan if force is None else setup["force_within"] - abs(force + GRAVITY * setup["mass"])


CLAIMS: Final[Mapping[str, Margin]] = {
    "peg-in-hole: moca-inserts": _inserts,
    "peg-in-hole: moca-force-below-payload": _light,
    "peg-in-hole: moca-as-published": _peg(peg_trial.MOCA_BARE.label, above=False),
    "peg-in-hole: kairos-exceeds-payload": _peg(peg_trial.KAIROS_BARE.label, above=True),
    "peg-in-hole: kairos-compliant-inserts": _peg(peg_trial.COMPLIANT.label, above=False),
    "wire-path: robot-fewer-errors": _fewer,
    "wire-path: robot-slower": _slower,
    "overhead-drilling: robot-more-holes": _each("N_Hl", 1.0),
    "overhead-drilling: robot-fewer-errors": _each("N_err", -1.0),
    "overhead-drilling: robot-slower": _hole_slower,
    "load-carrying: load-carried": _carried,
    "load-carrying: load-force": _force,
    "load-carrying: obstacles-clear": lambda rows, a: -1.0 if rows["load"]["touches"] else float(rows["load"]["least"]),
    "load-carrying: both-modes": lambda rows, a: 1.0 if load_carrying.modes(rows["load"]) else 0.0,
}


def analysed(
    chosen: Sequence[Point], found: Sequence[Rows]
) -> tuple[list[dict[str, Any]], dict[str, dict[str, float]]]:
    """Returns the table, a row for each claim and parameter that decides it, and all correlations by claim.

    A claim on which nothing has a correlation that is significant has one row. Points of which a trial is missing are
    left out of the claims that need it.
    """
    a = {name: assumed(name) for name in (STUDY, "peg-in-hole", "load-carrying")}
    table: list[dict[str, Any]] = []
    shown: dict[str, dict[str, float]] = {}
    for claim, margin in CLAIMS.items():
        margins = np.array([_margin(margin, rows, a) for rows in found])
        here = np.isfinite(margins)
        own = [point for point, there in zip(chosen, here, strict=True) if there]
        held = margins[here] > 0.0
        first = {"claim": claim, "holds at": f"{int(held.sum())} of {len(own)}"}
        lines = _decisive(own, margins[here], held)
        shown[claim] = {name: rho for name, (rho, _) in _correlations(own, margins[here]).items()}
        table += [first | line for line in lines] or [first | {"hinges on": "nothing that is significant"}]
    return table, shown


def _margin(margin: Margin, rows: Rows, a: Mapping[str, Any]) -> float:
    try:
        return margin(rows, a)
    except KeyError:  # a trial of it has no values
        return math.nan


def _correlations(own: Sequence[Point], margins: Any) -> dict[str, tuple[float, float]]:
    """Spearman's rank correlation with each parameter, and its p; none of too few points, or if all are alike."""
    from scipy.stats import spearmanr

    if len(own) < 4 or np.ptp(margins) == 0.0:
        return {}
    out = {}
    for name in own[0].values:
        found = spearmanr([point.values[name] for point in own], margins)
        out[name] = (float(found.statistic), float(found.pvalue))
    return out


def _decisive(own: Sequence[Point], margins: Any, held: Any) -> list[dict[str, Any]]:
    """A row for each parameter whose correlation is significant, the strongest first."""
    correlations = _correlations(own, margins)
    strong = {n: rho for n, (rho, p) in correlations.items() if p < LEVEL / len(correlations)}
    out = []
    for name in sorted(strong, key=lambda n: -abs(strong[n])):
        values = np.array([point.values[name] for point in own])
        low = values < np.median(values)
        out.append({
            "hinges on": name, "rank correlation": strong[name],
            "holds, lower half": f"{int(held[low].sum())} of {int(low.sum())}",
            "holds, upper half": f"{int(held[~low].sum())} of {int((~low).sum())}",
        })  # fmt: skip
    return out


def draw(path: Path, shown: Mapping[str, Mapping[str, float]], names: Sequence[str]) -> None:
    """Draws the rank correlations, claims by parameters."""
    from matplotlib.figure import Figure

    values = np.array([[own.get(name, math.nan) for name in names] for own in shown.values()])
    figure = Figure(figsize=(2.5 + 0.62 * len(names), 1.5 + 0.36 * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    image = axes.imshow(values, cmap="PuOr", vmin=-1.0, vmax=1.0, aspect="auto")
    for i, row in enumerate(values):
        for j, value in enumerate(row):
            if math.isfinite(value):
                axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
    axes.set_yticks(range(len(shown)), list(shown), fontsize=8)
    figure.colorbar(image, label="rank correlation with what the claim compares")
    axes.set_title("What the claims hinge on, simulated (empty: alike at all points)", fontsize=10)
    figure.savefig(path, dpi=110)
