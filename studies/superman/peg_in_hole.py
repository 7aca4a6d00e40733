"""Constrained interaction: persons lead a peg into a hole and out again, with MOCA and with Kairos (Fig. 11).

The paper shows curves of one run each, and payload lines; the payloads are the only figures it prints.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.gravity import GRAVITY
from srl.studies.result import Claim, Result
from srl.studies.superman import persons as people
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.peg_trial import COMPLIANT, CONDITIONS, KAIROS_BARE, MOCA, MOCA_BARE, STUDY, Condition
from srl.studies.superman.persons import COUNT, persons
from srl.studies.superman.shares import share
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask

TRIAL: Final = "superman-peg"
Rows = Sequence[Mapping[str, Any]]
BESIDE: Final = ((0.0, 2.0), (2.0, 4.0), (4.0, np.inf))  # mm, by which the table divides the persons
_QUICK: Final = 2  # persons
_FAULT: Final = "device fault"


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs every condition with every person; `quick`: two persons, Kairos alone."""
    chosen = [c for c in CONDITIONS.values() if not quick or c.robot == "kairos"]
    rows = runner.done(tasks(chosen, _QUICK if quick else COUNT), folder / "trials")
    found = {c.label: [dict(row.values) for row in rows if row.task.parameters["condition"] == c.label] for c in chosen}
    a = assumed(STUDY)
    result = Result(STUDY, simulated=True, seeds=[people.assumed()["seed"]], claims=claims(found, a))
    result.table = [line for c in chosen for line in lines(c, found[c.label], a)]
    shown = {label: next((r for r in own if r["series"]), None) for label, own in found.items()}
    if drawable := {label: row for label, row in shown.items() if row is not None}:
        draw(folder / "peg-in-hole.png", drawable, a)
        result.files = ["peg-in-hole.png"]
    return result


def tasks(chosen: Sequence[Condition], count: int) -> list[TrialTask]:
    """Returns the trials, person by person; the first person's rows have what the figure shows."""
    return [
        TrialTask.of(
            STUDY, TRIAL, person.number,
            {"person": asdict(person), "condition": c.label, "changed": {}, "series": person.number == 1},
            profile=c.profile,
        )
        for person in persons(count)
        for c in chosen
    ]  # fmt: skip


def payload(condition: Condition, a: dict[str, Any]) -> float:
    """Returns the robot's payload, N."""
    return float(a[f"payload_{condition.robot}"] * GRAVITY)


def lines(condition: Condition, rows: Rows, a: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns the table's rows of a condition: all persons, then those who aim so far beside the hole."""
    parts = [("all", list(rows))]
    for low, high in BESIDE:
        words = f"{low:g} mm and more" if np.isinf(high) else f"{low:g} to {high:g} mm"
        parts.append((words, [r for r in rows if low <= r["beside"] < high]))
    paper = {"moca": "inserted, below the line", "kairos": ""}[condition.robot]
    out = []
    for words, own in parts:
        if not own:
            continue
        force = np.array([r["force"] for r in own])
        out.append({
            "robot": condition.label, "aims beside by": words, "persons": len(own),
            "inserted": sum(r["inserted"] for r in own), "withdrew": sum(r["withdrew"] for r in own),
            "largest force N: median": float(np.median(force)), "least": float(force.min()),
            "most": float(force.max()), "mean force N: median": float(np.median([r["mean_force"] for r in own])),
            "over payload": int((force > payload(condition, a)).sum()), "payload N": payload(condition, a),
            "stopped": sum(bool(r["stop"]) for r in own),
            "paper": "above the line, stopped" if condition is KAIROS_BARE else paper,
        })  # fmt: skip
    return out


def claims(found: Mapping[str, Rows], a: dict[str, Any]) -> list[Claim]:
    """Returns the claims: each holds if the 95 % interval of the share of persons who confirm it is above a half."""
    light, heavy = payload(MOCA, a), payload(COMPLIANT, a)

    def claim(
        name: str, text: str, paper: str, condition: Condition, confirms: Callable[[Mapping[str, Any]], bool]
    ) -> Claim:
        rows = found.get(condition.label, [])
        force = [r["force"] for r in rows]
        spread = f", forces {min(force):.0f} to {max(force):.0f} N, median {np.median(force):.0f} N" if force else ""
        return share([confirms(r) for r in rows]).claim(name, f"{text}{spread}", paper)

    return [
        claim("moca-inserts", "MOCA inserts the peg and withdraws it", "yes (Fig. 11a)", MOCA, lambda r: r["withdrew"]),
        claim(
            "moca-force-below-payload", f"MOCA's largest external force is below {light:.1f} N",
            "below the line (Fig. 11a)", MOCA, lambda r: r["force"] < light,
        ),
        claim(
            "moca-as-published", f"MOCA as published does both, below {light:.1f} N", "yes (Fig. 11a)",
            MOCA_BARE, lambda r: r["withdrew"] and r["force"] < light,
        ),
        claim(
            "kairos-exceeds-payload", f"Kairos as published exceeds {heavy:.0f} N and is stopped", "yes (Fig. 11b)",
            KAIROS_BARE, lambda r: r["force"] > heavy and r["stop"] == _FAULT,
        ),
        claim(
            "kairos-compliant-inserts", f"Kairos with force feedback inserts and withdraws below {heavy:.0f} N", "",
            COMPLIANT, lambda r: r["withdrew"] and r["force"] < heavy,
        ),
    ]  # fmt: skip


def draw(path: Path, rows: Mapping[str, Mapping[str, Any]], a: dict[str, Any]) -> None:
    """Draws force over time and the peg's tip, as in Fig. 11, of one row for each condition with a series."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.4 * len(rows), 6), layout="constrained")
    axes = figure.subplots(2, len(rows), sharex="col", squeeze=False)
    for column, (label, row) in enumerate(rows.items()):
        found, top, low = json.loads(row["series"]), axes[0, column], axes[1, column]
        t = np.array(found["t"])
        top.plot(t, found["force"], color="lightsteelblue", linewidth=0.5, label="each cycle")
        top.plot(t, found["mean"], color="tab:blue", linewidth=0.8, label=f"mean over {1e3 * a['window']:g} ms")
        top.axhline(payload(CONDITIONS[label], a), color="tab:red", linestyle="--", label="payload")
        top.set_title(f"{label}\n{row['force']:.0f} N, " + (f"stopped: {row['stop']}" if row["stop"] else "no stop"))
        top.set_ylabel("external force, N")
        top.legend(loc="upper left")
        tip, desired = np.array(found["tip"]), np.array(found["desired"])
        for k, (axis, colour) in enumerate(zip("xyz", ("tab:orange", "tab:green", "tab:purple"), strict=True)):
            low.plot(t, tip[:, k], color=colour, linewidth=1.0, label=axis)
            low.plot(t, desired[:, k], color=colour, linestyle="--", linewidth=0.7)
        low.axhline(0.0, color="black", linestyle=":", linewidth=0.8)
        if row["stopped_at"] is not None:
            for each in (top, low):
                each.axvline(row["stopped_at"], color="grey", linewidth=0.8)
        low.set_ylim(-120, 120)
        low.set_xlabel("time, s")
        low.set_ylabel("peg's tip from the hole's mouth, mm\n(dashed: desired)")
        low.legend(loc="upper right", ncols=3)
    figure.suptitle(f"Peg in hole, simulated, one person, {row['beside']:.1f} mm beside, {row['tilted']:.1f} degrees")
    figure.savefig(path, dpi=110)
