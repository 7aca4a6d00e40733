"""Common parts of the two user studies: trials that run once and are kept, tables and boxplots beside the paper's."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.result import Result
from studies.runs import PROFILES, Run, Task, run_all
from studies.superman.persons import Person
from studies.superman.published import CONDITIONS
from studies.toolkit import boxplots
from studies.toolkit.statistics import paired_t, shapiro_wilk, words
from studies.toolkit.tables import Printed, Table
from studies.toolkit.trials import Trial

Mask = NDArray[np.bool_]
KEPT: Final = "trials.jsonl"
_BUTTONS: Final = {"admittance": "A", "mode": "M", "gripper": "G", "priority": "P"}
MUSCLES: Final = ("AD", "PD", "BC", "TR")  # in the order of the person's activations


@dataclass(frozen=True)
class Planned:
    """A trial to be run: its person, its condition, and the function that reads its figures."""

    person: Person
    condition: str
    task: Task
    read: Callable[[Run], dict[str, float]]

    @property
    def key(self) -> str:
        """A key that changes if anything changes on which the run depends, except the program."""
        profile = (PROFILES / f"{self.task.profile}.yaml").read_text(encoding="utf-8")
        words = json.dumps([profile, self.task.changes, self.task.duration, self.task.seed], sort_keys=True)
        return hashlib.sha256(words.encode()).hexdigest()[:16]


def trials(planned: Iterable[Planned], folder: Path) -> list[Trial]:
    """Runs the missing trials; those of an interrupted study are taken from `folder`.

    A recording of three minutes takes half a gigabyte, so each one is read and released before the next.
    """
    file, lock = folder / KEPT, Lock()
    kept: dict[str, dict[str, Any]] = {}
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            kept[entry["key"]] = entry

    def one(trial: Planned) -> Trial:
        entry = kept.get(trial.key)
        if entry is None or not (folder / entry["file"]).exists():
            run = run_all([trial.task], folder, 1)[0]
            entry = {
                "key": trial.key, "subject": trial.person.name, "condition": trial.condition, "file": run.file.name,
                "figures": trial.read(run),
            }  # fmt: skip
            del run
            with lock, file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(entry) + "\n")
        return Trial(trial.person.name, trial.condition, entry["figures"], entry["file"])

    with ThreadPoolExecutor(max((os.cpu_count() or 2) - 1, 1)) as pool:
        return list(pool.map(one, planned))


def plan(steps: Iterable[Any], patience: float) -> list[dict[str, Any]]:
    """Converts steps of sim.parts.person.plans to the form of a profile, with the profiles' buttons."""
    out = []
    for step in steps:
        entry = step.model_dump(mode="json", exclude_none=True)
        if "button" in entry:
            entry["button"] = _BUTTONS[entry["button"]]
        if "patience" in entry:
            entry["patience"] = patience
        out.append(entry)
    return out


def alone(parts: dict[str, Any]) -> dict[str, Any]:
    """Returns changes to the profile moca-man: a person without a robot, electrodes on the arm, at 100 Hz."""
    gone = dict.fromkeys(("panel", "sensor", "arm", "base", "hand"))
    muscles = {"anterior_deltoid": 1, "posterior_deltoid": 2, "biceps": 3, "triceps": 4}
    return {
        "rate": 100,
        "clock": None,
        "devices": gone | {"emg": {"driver": "trigno", "port": "tcp://192.168.1.30", "channels": muscles}},
        "controllers": [],
        "guard": None,
        "stop": None,
        "frames": None,
        "sim": {
            "ends_with": "person",
            "floor": False,
            "parts": dict.fromkeys(("base", "arm", "hand", "sensor", "grip")) | parts,
            "devices": {"panel": None, "sensor": None, "emg": {"part": "person"}},
        },
    }


def between(run: Run, first: int, last: int) -> Mask:
    """Returns whether each row, (k,), lies in the plan's steps first to last, both included."""
    step = run.value("world.person_progress")[:, 0]
    inside: Mask = (step >= first) & (step <= last)
    return inside


def activity(run: Run, inside: Mask) -> dict[str, float]:
    """Returns the mean activation by muscle, percent of the greatest voluntary contraction, over the rows `inside`."""
    means = 100 * run.value("world.person_activation")[inside].mean(axis=0)
    return dict(zip(MUSCLES, (round(float(v), 3) for v in means), strict=True))


def rows(
    table: Table, beside: Mapping[str, Printed], extra: Sequence[str], found: Sequence[Trial]
) -> list[dict[str, Any]]:
    """Returns a row for each subject, then means (deviations) and tests, each beside the published one.

    Args:
        extra: measures of the trials that aren't in the table, for the subjects' rows only.
    """
    by = {(t.subject, t.condition): t for t in found}
    out: list[dict[str, Any]] = []
    for i, subject in enumerate(table.subjects):
        row: dict[str, Any] = {"subject": subject}
        for m in table.measures:
            row |= {f"{m.name} {c}": round(float(m.values[c][i]), 2) for c in CONDITIONS}
        for name in extra:
            row |= {f"{name} {c}": round(by[subject, c].values[name], 2) for c in CONDITIONS}
        out.append(row)
    summary: dict[str, dict[str, Any]] = {
        name: {"subject": name} for name in ("mean (sd)", "published", "sign test", "t-test", "Shapiro-Wilk")
    }
    for m in table.measures:
        first = f"{m.name} {CONDITIONS[0]}"
        for c in CONDITIONS:
            got = m.summary(c)
            summary["mean (sd)"][f"{m.name} {c}"] = f"{got.mean:.2f} ({got.deviation:.2f})"
            mean, deviation = beside[m.name].figures[c]
            summary["published"][f"{m.name} {c}"] = f"{mean:.2f} ({deviation:.2f})"
        summary["sign test"][first] = words(table.sign_test(m.name).p)
        level = beside[m.name].significant
        summary["sign test"][f"{m.name} {CONDITIONS[1]}"] = "paper: n.s." if level is None else f"paper: p < {level:g}"
        one, other = (list(m.values[c]) for c in CONDITIONS)
        gaps = {a - b for a, b in zip(one, other, strict=True)}
        if len(gaps) > 1 and len(one) >= 3:
            summary["t-test"][first] = words(paired_t(one, other).p)
            summary["Shapiro-Wilk"][first] = words(shapiro_wilk([a - b for a, b in zip(one, other, strict=True)]).p)
    return [{key: row.get(key) for key in out[0]} for row in (*out, *summary.values())]


def pictures(table: Table, folder: Path, title: str) -> list[str]:
    """Draws boxplots of the measures, one picture each; returns the files' names."""
    files = []
    for m in table.measures:
        file = f"{m.name.lower()}.png"
        boxplots.draw(
            {m.name: m.values},
            CONDITIONS,
            folder / file,
            title=f"{title}: {m.meaning}",
            unit=m.unit,
            names={m.name: ""},
        )
        files.append(file)
    return files


def muscles(found: Sequence[Trial], folder: Path, title: str) -> str:
    """Draws boxplots of the muscles' mean activity; returns the file's name."""
    subjects = list(dict.fromkeys(t.subject for t in found))
    by = {(t.subject, t.condition): t.values for t in found}
    groups = {name: {c: [by[s, c][name] for s in subjects] for c in CONDITIONS} for name in MUSCLES}
    boxplots.draw(groups, CONDITIONS, folder / "activity.png", title=f"{title}: muscles", unit="% of the greatest")
    return "activity.png"


def varied(people: Sequence[Person], factors: Mapping[str, Sequence[float]]) -> list[tuple[str, list[Person]]]:
    """Returns the persons as they are, then with one property at a time multiplied, each with a label."""
    out = [("as listed", list(people))]
    for name, all_of in factors.items():
        for factor in all_of:
            changed = [replace(p, **{name: getattr(p, name) * factor}) for p in people]
            out.append((f"{name} x {factor:g}", changed))
    return out


def swept(variants: Iterable[tuple[str, Result]]) -> list[dict[str, Any]]:
    """Returns a row for each variant: each claim's measured value, and whether it held."""
    return [
        {"persons": label}
        | {c.id: f"{c.measured:+.2f} {c.unit}, {'holds' if c.holds else 'does not hold'}" for c in result.claims}
        for label, result in variants
    ]


def slug(label: str) -> str:
    """Returns a variant's name for recordings; "" for the persons as they are."""
    return "" if label == "as listed" else "-" + "".join(c if c.isalnum() else "-" for c in label)
