"""Simulated people who do the ten actions, what a suit measures of them, and the law `intention` by itself."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np

from drivers.noitom.skeleton import Skeleton
from helpers.control import bound
from runtime.contracts.files import KeptFile
from runtime.contracts.signals import Array
from runtime.contracts.wearer import Action, Perform, Rest, Walk
from runtime.control.intention.features import RATE, frames, joints, trunk_of
from runtime.control.intention.law import Intention, IntentionConfig
from runtime.control.intention.record import Record
from runtime.control.intention.training import Held, Recogniser, Thresholds, Trial, train
from sim.parts.body.motion import Script, Scripted
from sim.wearer.people import MISFIT, subject
from sim.wearer.performer import Performer, measured

SKELETON = Skeleton("axis-neuron")
TRUNK = trunk_of(SKELETON.names)
JOINTS = np.array([SKELETON.names.index(name) for name in joints(TRUNK)])
ACTIONS = get_args(Action)
THRESHOLDS = Thresholds()
DT = 1.0 / RATE


@dataclass(frozen=True)
class Session:
    """What a suit measured at RATE: times (T,) s, rotation (T, n, 4), translation (T, n, 3) of the law's joints.

    `said`: from, to (s), label, and number of the repetition.
    """

    times: Array
    rotation: Array
    translation: Array
    said: list[tuple[float, float, str, int]]

    def trials(self, group: int | None = None) -> list[Trial]:
        """`group`: of all, instead of the repetition."""
        made = frames(self.rotation, self.translation)
        return [
            Trial(label, repetition if group is None else group, made[(self.times >= a) & (self.times < b)])
            for a, b, label, repetition in self.said
        ]


@cache
def session(number: int, repetitions: int = 3, seed: int = 0, actions: tuple[Action, ...] = ACTIONS) -> Session:
    """A simulated person's session: in each repetition it stands, does each action in a drawn order, and walks."""
    rng = np.random.default_rng([number, seed])
    person, t, said = Performer(subject(number, SKELETON.names), SKELETON), 0.0, list[tuple[float, float, str, int]]()
    for repetition in range(repetitions):
        person.instruct(t, Rest())
        said.append((t + 2.0, t + 5.0, "stand", repetition))
        t += 5.0
        for k in rng.permutation(len(actions)):
            person.instruct(t, Perform(actions[k]))
            said.append((t + THRESHOLDS.lead, t + 3.0, actions[k], repetition))
            person.instruct(t + 3.0, Rest())
            said.append((t + 4.5, t + 5.5, "stand", repetition))
            t += 5.5
        person.instruct(t, Walk())
        said.append((t + 2.0, t + 8.0, "walk", repetition))
        t += 8.0
    times = np.arange(0.0, t, DT)
    rotation, translation = measured(person, times, MISFIT, 0.002, seed=1000 * number + seed)
    return Session(times, rotation[:, JOINTS], translation[:, JOINTS], said)


@cache
def own(number: int) -> tuple[Recogniser, Held]:
    """A simulated person's recogniser, from three repetitions."""
    return train(session(number).trials(), THRESHOLDS)


@cache
def of_people(numbers: tuple[int, ...]) -> tuple[Recogniser, Held]:
    """A recogniser of several simulated people, each of whom was held out in turn."""
    return train([t for n in numbers for t in session(n, 2).trials(group=n)], THRESHOLDS)


def record_of(made: tuple[Recogniser, Held], person: str = "S1") -> Record:
    day = datetime.date(2026, 1, 2)
    return Record.of(*made, THRESHOLDS, person=person, date=day, simulated=True, trunk=TRUNK)


def law_of(made: Record, **options: Any) -> Intention:
    file = KeptFile(Path("recogniser.json"), made.model_dump_json().encode())
    return bound(Intention("intention", IntentionConfig(recogniser=file, **options)))


def put(law: Intention, rotation: Array, translation: Array) -> None:
    law.input["rotation"][:], law.input["translation"][:] = rotation, translation


def play(law: Intention, rotation: Array, translation: Array, dt: float = DT) -> dict[str, Array]:
    """The outputs (T, ...) by name over a motion, from a reset at its beginning."""
    put(law, rotation[0], translation[0])
    law.reset()
    rows = []
    for q, p in zip(rotation, translation, strict=True):
        put(law, q, p)
        law.update(dt)
        rows.append({name: value.copy() for name, value in law.output.items()})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def script(kind: Script, seconds: float, seed: int = 1) -> tuple[Array, Array]:
    """What an ideal suit measures of the cell's scripted person, who knows no action."""
    motion = Scripted(kind, SKELETON, 1.0, seed, "person")
    poses = [motion.at(t) for t in np.arange(0.0, seconds, DT).tolist()]
    translation = np.tile(motion.offsets, (len(poses), 1, 1))
    translation[:, 0] = [hips for hips, _ in poses]
    return np.array([q for _, q in poses])[:, JOINTS], translation[:, JOINTS]


def begun(action: Array) -> list[int]:
    """The numbers of the actions that began, in turn; `action` (T, k)."""
    held = np.where(action.any(axis=1), action.argmax(axis=1), -1)
    return [int(b) for a, b in zip([-1, *held[:-1]], held, strict=True) if b not in (a, -1)]


def found(out: dict[str, Array], law: Intention, made: Session) -> Sequence[tuple[str, set[str]]]:
    """Per action that was done: its name, and the names of those that held from its word to 0.6 s after its end."""
    labels = law.outputs[0].labels
    rows = []
    for a, b, label, _ in made.said:
        if label in labels:
            held = out["action"][(made.times >= a) & (made.times < b + 0.6)].any(axis=0)
            rows.append((label, {name for name, here in zip(labels, held, strict=True) if here}))
    return rows
