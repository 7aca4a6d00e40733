"""A trial's figures (time, touches, holes), and trials gathered into a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from srl.runtime.contracts.signals import Array
from srl.studies.toolkit import sheets
from srl.studies.toolkit.errors import StudyError, pairs
from srl.studies.toolkit.tables import Measure, Table


@dataclass(frozen=True)
class Trial:
    """One subject under one condition.

    Attributes:
        subject, condition: e.g. "S1", "HR".
        values: by measure.
        place: the source, for errors.
    """

    subject: str
    condition: str
    values: Mapping[str, float]
    place: str = "trials"


def touches(time: ArrayLike, force: ArrayLike, threshold: float, apart: float = 0.2) -> list[float]:
    """Returns the times at which contacts began, s: the errors of a task in which nothing may be touched.

    A contact that returns within `apart` of its end is the same one: a ring that bounces on a wire counts once.
    A contact that exists at the start counts.

    Args:
        time: (k,) s, rising.
        force: (k,) N, its magnitude is used; or 0 and 1 of a contact wire.
        threshold: contact above this value, in the same unit.
        apart: s.

    Raises:
        StudyError: they don't pair, time doesn't rise, or the threshold isn't positive.
    """
    t, f = _timed("touches", time, force)
    if not threshold > 0 or not apart >= 0:
        problem = f"threshold {threshold:g} and apart {apart:g}; expected more than 0 and at least 0"
        raise StudyError("touches", problem, "Take a force well above the sensor's noise")
    contact = np.abs(f) > threshold
    began = np.flatnonzero(contact & ~np.concatenate(([False], contact[:-1])))
    ended = np.flatnonzero(contact & ~np.concatenate((contact[1:], [False])))  # the last sample of each
    return [float(t[b]) for i, b in enumerate(began) if i == 0 or t[b] - t[ended[i - 1]] > apart]


def holds(time: ArrayLike, inside: ArrayLike, least: float) -> list[tuple[float, float]]:
    """Returns the spans in which `inside` held for at least `least` without a break: holes completed, pauses kept.

    Args:
        time: (k,) s, rising.
        inside: (k,) 0 or 1.
        least: s.

    Raises:
        StudyError: they don't pair, or time doesn't rise.
    """
    t, values = _timed("holds", time, inside)
    there = np.concatenate(([False], values > 0.5, [False]))
    edges = np.flatnonzero(there[1:] != there[:-1])
    spans = [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    # A span of exactly `least` must not fail because its ends are rounded.
    return [(a, b) for a, b in spans if b - a >= least * (1 - 1e-9)]


def each(duration: float, count: float, what: str = "hole") -> float:
    """Returns the time per completed item, s; raises StudyError if none was completed."""
    if not count > 0 or not duration >= 0:
        raise StudyError("trials", f"{count:g} {what}s in {duration:g} s", f"A time for each {what} needs at least one")
    return duration / count


def read(path: Path, measures: Sequence[str]) -> list[Trial]:
    """Reads trials from a sheet with the columns subject, condition and the measures; capitals don't matter.

    Raises:
        StudyError: the sheet or a cell in it is invalid.
    """
    trials = []
    for line in sheets.read(path, ["subject", "condition", *(name.lower() for name in measures)]):
        subject, condition = line.cells.get("subject", ""), line.cells.get("condition", "")
        if not subject or not condition:
            raise StudyError(line.place, "subject or condition is empty", "Fill it in")
        values = {name: line.number(name.lower()) for name in measures}
        trials.append(Trial(subject, condition, values, line.place))
    return trials


def table(
    title: str, trials: Iterable[Trial], conditions: tuple[str, str], measures: Mapping[str, tuple[str, str]]
) -> Table:
    """Gathers trials: one for each subject and condition, subjects in the order in which they come.

    Args:
        title: the line above the table.
        trials: those of other conditions are left out.
        conditions: two of them.
        measures: name: (unit, meaning).

    Raises:
        StudyError: a subject lacks a condition or has it twice, or a trial lacks a measure.
    """
    found: dict[tuple[str, str], Trial] = {}
    for trial in trials:
        if trial.condition not in conditions:
            continue
        key = (trial.subject, trial.condition)
        if key in found:
            raise StudyError(trial.place, f"{trial.subject} has {trial.condition} twice", "Keep one, or average them")
        if missing := [name for name in measures if name not in trial.values]:
            problem = f"{trial.subject}, {trial.condition}: no {', '.join(missing)}"
            raise StudyError(trial.place, problem, "Measure it, or leave the measure out")
        found[key] = trial
    subjects = list(dict.fromkeys(subject for subject, _ in found))
    for subject in subjects:
        if missing := [condition for condition in conditions if (subject, condition) not in found]:
            problem = f"{subject} has no trial of {', '.join(missing)}"
            raise StudyError(title, problem, "Add it, or leave the subject out")
    return Table(
        title,
        subjects,
        conditions,
        [
            Measure(name, unit, meaning, {c: [found[s, c].values[name] for s in subjects] for c in conditions})
            for name, (unit, meaning) in measures.items()
        ],
    )


def _timed(place: str, time: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    t, found = pairs(place, time, values)
    if not (np.diff(t) > 0).all():
        raise StudyError(place, "the time doesn't rise from sample to sample", "Sort it; give each sample its own time")
    return t, found
