"""From labelled motion to a recogniser, what it is worth on motion that it wasn't made from, and why it is refused."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from srl.control.intention.decision import NONE, Decision
from srl.control.intention.discriminant import Discriminant, fit, temperature
from srl.control.intention.features import FEATURES, FRAMES, RATE, features
from srl.control.intention.triggers import DWELLS, RATIOS, Triggers, choose, looks
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

BACKGROUND: Final = ("stand", "walk")
"""What isn't an action, though it has a class: the recogniser must know it to tell actions from it."""
EVERYDAY: Final = "everyday"
"""The label of motion that means none of the actions. It has no class: it sets how near to an action counts."""
_STEP: Final = 2  # frames between two windows that are learned from


class TrainingError(SrlError):
    """Motion from which no recogniser can be made."""


class Thresholds(Options):
    """What a recogniser is made of, and what is refused. A file brings its own: no file goes beyond their bounds."""

    repetitions: int = Field(3, ge=2, description="least number of repetitions, or people, that an action needs")
    lead: float = Field(
        0.4, ge=0.0, le=2.0, description="s after the word for an action that don't count: nobody moves sooner"
    )
    settle: float = Field(
        2.0,
        ge=0.0,
        le=5.0,
        description="s at the beginning of standing and walking that don't count: what was before ends",
    )
    quantile: float = Field(
        0.98, ge=0.8, le=1.0, description="share of held-out windows that the limit of their class must let through"
    )
    slack: float = Field(
        1.3, ge=1.0, le=3.0, description="by which the limits are wider than that, in squared distance"
    )
    confidence: float = Field(0.6, ge=0.2, le=1.0, description="least posterior of an action that counts as seen")
    dwell: float | None = Field(
        None, ge=0.0, le=3.0, description="s for which an action must be seen before it is active; null: chosen"
    )
    trigger: float | None = Field(
        None, gt=0.0, le=1.0, description="ratio to the limits within which an action counts as meant; null: chosen"
    )
    cost: float = Field(1.0, ge=0.0, le=100.0, description="of a trigger by an unknown motion, in missed actions")
    alarms: float = Field(
        2.0, gt=0.0, description="a minute, that the everyday motion must make unlikely (95 %), if it is recorded"
    )
    release: float = Field(0.3, ge=0.0, le=3.0, description="s without it before it ends")
    recall: float = Field(
        0.7, ge=0.5, le=1.0, description="least share of an action's held-out windows that are seen as this action"
    )
    found: float = Field(0.6, ge=0.5, le=1.0, description="least share of an action's held-out trials that are found")


@dataclass(frozen=True)
class Trial:
    """One stretch of motion under one label.

    Attributes:
        label: an action's name, one of BACKGROUND, or EVERYDAY.
        group: number of the repetition, or of the person, that is held out together.
        frames: (T, FRAME) at RATE.
    """

    label: str
    group: int
    frames: Array


@dataclass(frozen=True)
class Recogniser:
    """The classes' names (actions, then those of BACKGROUND that were recorded), their discriminant, and triggers."""

    actions: tuple[str, ...]
    background: tuple[str, ...]
    discriminant: Discriminant
    triggers: Triggers

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of all classes."""
        return self.actions + self.background


@dataclass(frozen=True)
class Held:
    """What recognisers made without a group say of it, for all groups. k actions, m classes.

    Attributes:
        confusion: (m, m + 1) windows by what they are and what they are taken for; the last column is rejected.
        found: (k,) trials in which the action was found.
        wrong: (k,) trials in which another action was found.
        trials: (k,) of them.
        delay: (k,) s, median, from the trial's beginning to where it was found; NaN if never.
        alarms: actions found in trials of the background; `seconds` of it.
    """

    confusion: NDArray[np.intp]
    found: NDArray[np.intp]
    wrong: NDArray[np.intp]
    trials: NDArray[np.intp]
    delay: Array
    alarms: int
    seconds: float

    @property
    def accuracy(self) -> float:
        """Mean over the classes of the share of windows that are taken for what they are."""
        return float(np.mean(np.diag(self.confusion) / self.confusion.sum(axis=1)))

    @property
    def rejected(self) -> float:
        """Share of all windows that are rejected."""
        return float(self.confusion[:, -1].sum() / self.confusion.sum())


def windows(frames: Array, step: int = 1) -> Array:
    """Features (W, FEATURES) of the windows in frames (T, FRAME), every `step` frames."""
    starts = range(0, len(frames) - FRAMES + 1, step)
    return np.array([features(frames[at : at + FRAMES]) for at in starts]).reshape(len(starts), FEATURES)


def train(trials: Sequence[Trial], thresholds: Thresholds) -> tuple[Recogniser, Held]:
    """Makes a recogniser of all trials, and holds out one group after another to see what it is worth.

    Raises:
        TrainingError: there are too few actions or repetitions, or a trial is too short.
    """
    everyday = [windows(trial.frames) for trial in trials if trial.label == EVERYDAY]
    trials = [trial for trial in trials if trial.label != EVERYDAY]
    labels = [trial.label for trial in trials]
    actions = tuple(dict.fromkeys(label for label in labels if label not in BACKGROUND))
    background = tuple(label for label in BACKGROUND if label in labels)
    _enough(trials, actions, background, thresholds)
    names = actions + background
    kind = np.array([names.index(label) for label in labels])
    # Every window at the recogniser's own rate; those that are learned from are fewer.
    every = [windows(trial.frames) for trial in trials]
    some = [each[::_STEP] for each in every]
    group = np.array([trial.group for trial in trials])
    distances: list[Array] = [np.empty(0)] * len(trials)
    for out in np.unique(group):
        inside = np.flatnonzero(group != out)
        without = _fit([some[i] for i in inside], kind[inside], len(names))
        for i in np.flatnonzero(group == out):
            distances[i] = without.distances(every[i])
    apart, truth = np.concatenate(distances), np.repeat(kind, [len(each) for each in every])
    own = apart[np.arange(len(truth)), truth]
    limits = np.array([np.quantile(own[truth == k], thresholds.quantile) for k in range(len(names))])
    found = replace(
        _fit(some, kind, len(names)), limits=thresholds.slack * limits, temperature=temperature(apart, truth)
    )
    parts = list(zip(kind.tolist(), distances, strict=True))
    triggers = choose(
        found, len(actions), parts, [found.distances(each) for each in everyday if len(each)],
        confidence=thresholds.confidence, cost=thresholds.cost, slack=thresholds.slack,
        dwells=DWELLS if thresholds.dwell is None else (thresholds.dwell,),
        ratios=RATIOS if thresholds.trigger is None else (thresholds.trigger,),
    )  # fmt: skip
    made = Recogniser(actions, background, found, triggers)
    return made, _judge(made, thresholds, parts)


def seen(recogniser: Recogniser, distances: Array) -> NDArray[np.intp]:
    """(T,): the class of each row of squared distances (T, m), or m where it is rejected."""
    best = distances.argmin(axis=1)
    outside = distances.min(axis=1) > recogniser.discriminant.limits[best]
    return np.where(outside, len(recogniser.labels), best)


def refusals(recogniser: Recogniser, held: Held, thresholds: Thresholds) -> tuple[TrainingError, ...]:
    """Why a recogniser can't be used; none if it can."""
    return tuple(_refused(recogniser, held, thresholds))


def _refused(recogniser: Recogniser, held: Held, thresholds: Thresholds) -> Iterator[TrainingError]:
    names = (*recogniser.labels, "nothing known")
    triggers = recogniser.triggers
    if triggers.everyday > 0.0 and triggers.alarms > thresholds.alarms:
        problem = (
            f"{triggers.everyday:.0f} s set the triggers of {triggers.lowered} actions, so other motion like it may "
            f"give {triggers.alarms:.1f} false activations a minute (95 %), {thresholds.alarms:g} may be"
        )
        remedy = f"Record {triggers.alarms * triggers.everyday / thresholds.alarms:.0f} s or more"
        yield TrainingError(EVERYDAY, problem, f"{remedy} (`--option everyday`), or allow more (`--option alarms`)")
    for k, action in enumerate(recogniser.actions):
        row = held.confusion[k]
        share, found = row[k] / row.sum(), held.found[k] / held.trials[k]
        others = np.where(np.arange(len(row)) == k, -1, row)
        other = names[int(others.argmax())]
        remedy = f"Do it again, more alike each time and less like {other}, or leave it out"
        if share < thresholds.recall:
            problem = (
                f"{share:.0%} of its held-out windows are seen as it, {thresholds.recall:.0%} are needed; "
                f"{others.max() / row.sum():.0%} are taken for {other}"
            )
            yield TrainingError(f"action {action}", problem, remedy)
        elif found < thresholds.found:
            problem = f"it is found in {held.found[k]} of {held.trials[k]} held-out trials"
            if triggers.limits[k] < triggers.limits.max():
                problem += ": the everyday motion looks like it"
                remedy = "Choose an action that you don't do anyway, or leave it out"
            yield TrainingError(f"action {action}", problem, remedy)


def _enough(
    trials: Sequence[Trial], actions: tuple[str, ...], background: tuple[str, ...], thresholds: Thresholds
) -> None:
    if len(actions) < 2:
        raise TrainingError("actions", f"there are {len(actions)}, 2 are needed", "Record more actions")
    for name in actions + background:
        own = [trial for trial in trials if trial.label == name]
        place = f"action {name}" if name in actions else name
        for trial in own:
            if len(trial.frames) < FRAMES:
                problem = (
                    f"repetition {trial.group + 1} has {len(trial.frames) / RATE:.1f} s, {FRAMES / RATE:.1f} s needed"
                )
                raise TrainingError(place, problem, "Do it again, and go on until the next word")
        least = thresholds.repetitions if name in actions else 2
        if (groups := len({trial.group for trial in own})) < least:
            problem = f"it was done {groups} times, {least} are needed"
            raise TrainingError(place, problem, "Do it more often")


def _fit(samples: list[Array], kind: NDArray[np.intp], count: int) -> Discriminant:
    return fit(np.concatenate(samples), np.repeat(kind, [len(each) for each in samples]), count)


def _judge(recogniser: Recogniser, thresholds: Thresholds, parts: list[tuple[int, Array]]) -> Held:
    k, m = len(recogniser.actions), len(recogniser.labels)
    confusion = np.zeros((m, m + 1), np.intp)
    found, wrong, trials = (np.zeros(k, np.intp) for _ in range(3))
    delays: list[list[float]] = [[] for _ in range(k)]
    alarms, seconds = 0, 0.0
    limits = np.append(recogniser.triggers.limits, np.full(m - k, -1.0))  # what isn't an action never counts
    for kind, distances in parts:
        confusion[kind] += np.bincount(seen(recogniser, distances), minlength=m + 1)
        decision, held = Decision(recogniser.triggers.dwell, thresholds.release), list[tuple[int, int]]()
        nearest, ratio = looks(recogniser.discriminant, distances, thresholds.confidence)
        for at, number in enumerate(np.where(ratio <= limits[nearest], nearest, NONE).tolist()):
            before = decision.action
            action = decision.next(number, 1.0 / RATE)
            if action not in (before, NONE):
                held.append((at, action))
        if kind >= k:
            alarms, seconds = alarms + len(held), seconds + len(distances) / RATE
            continue
        trials[kind] += 1
        wrong[kind] += any(action != kind for _, action in held)
        if own := [at for at, action in held if action == kind]:
            found[kind] += 1
            delays[kind].append(thresholds.lead + (own[0] + FRAMES) / RATE)
    middle = np.array([np.median(each) if each else np.nan for each in delays])
    return Held(confusion, found, wrong, trials, middle, alarms, seconds)
