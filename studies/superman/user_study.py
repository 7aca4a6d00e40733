"""Common parts of the two user studies: trials as tasks, claims of pairs of trials, tables and boxplots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from srl.studies.result import Claim
from srl.studies.superman.persons import Person
from srl.studies.superman.published import CONDITIONS
from srl.studies.superman.user_trial import MUSCLES
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask
from srl.studies.toolkit import boxplots
from srl.studies.toolkit.estimates import Estimate, estimate
from srl.studies.toolkit.statistics import paired_t, shapiro_wilk, sign_test, words
from srl.studies.toolkit.tables import Printed, Table
from srl.studies.toolkit.trials import Trial


def tasks(
    study: str, trial: str, profiles: Mapping[str, str], people: Sequence[Person], **given: Any
) -> list[TrialTask]:
    """Returns the trials of all persons, those alone first, as they take less time.

    Args:
        study, trial: registered names.
        profiles: by condition.
        people: with whom.
        given: further parameters.
    """
    return [
        TrialTask.of(
            study, trial, person.number,
            {"person": asdict(person), "condition": condition, "changed": {}, **given}, profile=profiles[condition],
        )
        for condition in reversed(CONDITIONS)
        for person in people
    ]  # fmt: skip


def trials(runner: Runner, asked: Sequence[TrialTask], folder: Path) -> list[Trial]:
    """Runs the tasks. A person one of whose trials has no values is left out of both conditions."""
    rows = runner.rows(asked, folder)
    lost = {row.task.parameters["person"]["name"] for row in rows if not row.done}
    return [
        Trial(
            row.task.parameters["person"]["name"], row.task.parameters["condition"],
            {name: math.nan if value is None else value for name, value in row.values.items()},  # type: ignore[misc]
            f"{folder.name}, seed {row.task.seed}",
        )
        for row in rows
        if row.task.parameters["person"]["name"] not in lost
    ]  # fmt: skip


@dataclass(frozen=True)
class Paired:
    """A measure of the persons who have it under both conditions.

    Attributes:
        first, second: means under HR and H.
        difference: HR less H, person by person.
        ratio: HR over H, person by person.
        p: of the sign test, in words.
        out: persons without it.
    """

    first: float
    second: float
    difference: Estimate
    ratio: Estimate
    p: str
    out: tuple[str, ...]

    def __str__(self) -> str:
        out = f"; without {', '.join(self.out)}" if self.out else ""
        return (
            f"{self.first:.2f} against {self.second:.2f}, difference {self.difference} of {self.difference.n} persons, "
            f"sign test {self.p}{out}"
        )

    def claim(self, name: str, text: str, paper: str, unit: str, *, more: bool) -> Claim:
        """Returns a claim that HR has more (or less) than H: it holds if the whole 95 % interval is on that side."""
        d = self.difference
        return Claim(
            id=name, text=f"{text}: {self}", paper=paper, measured=d.mean, unit=unit,
            holds=d.low > 0.0 if more else d.high < 0.0,
        )  # fmt: skip


def paired(found: Sequence[Trial], measure: str, *, finished: bool = False) -> Paired:
    """Compares a measure under both conditions; `finished`: of the trials that were finished alone."""

    def of(trial: Trial) -> float:
        left = finished and not trial.values["finished"]
        return math.nan if left else trial.values[measure]

    by = {(t.subject, t.condition): of(t) for t in found}
    subjects = list(dict.fromkeys(t.subject for t in found))
    here = [s for s in subjects if not any(math.isnan(by[s, c]) for c in CONDITIONS)]
    one, other = ([by[s, c] for s in here] for c in CONDITIONS)
    return Paired(
        first=estimate(one).mean,
        second=estimate(other).mean,
        difference=estimate([a - b for a, b in zip(one, other, strict=True)]),
        ratio=estimate([a / b for a, b in zip(one, other, strict=True) if b]),
        p=words(sign_test(one, other).p) if here else "not made",
        out=tuple(s for s in subjects if s not in here),
    )


def rows(
    table: Table, beside: Mapping[str, Printed], extra: Sequence[str], found: Sequence[Trial]
) -> list[dict[str, Any]]:
    """Returns a row for each subject, then means (deviations) with intervals and tests, beside the published ones.

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
            row |= {f"{name} {c}": round(by[subject, c].values.get(name, math.nan), 2) for c in CONDITIONS}
        out.append(row)
    summary: dict[str, dict[str, Any]] = {
        name: {"subject": name}
        for name in ("mean (sd)", "95 % interval", "published", "sign test", "t-test", "Shapiro-Wilk")
    }
    for m in table.measures:
        first = f"{m.name} {CONDITIONS[0]}"
        for c in CONDITIONS:
            got, mean_of = m.summary(c), estimate(m.values[c])
            summary["mean (sd)"][f"{m.name} {c}"] = f"{got.mean:.2f} ({got.deviation:.2f})"
            summary["95 % interval"][f"{m.name} {c}"] = f"{mean_of.low:.2f} to {mean_of.high:.2f}"
            mean, deviation = beside[m.name].metrics[c]
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
