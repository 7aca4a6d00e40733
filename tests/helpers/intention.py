"""Simulated people's recognisers, and the law `intention` by itself."""

from __future__ import annotations

import datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from helpers.control import bound
from srl.control.intention.law import Intention, IntentionConfig
from srl.control.intention.record import Record
from srl.control.intention.training import Held, Recogniser, Thresholds, train
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.signals import Array
from srl.studies.intention import people
from srl.studies.intention.people import ACTIONS, DT, JOINTS, SKELETON, TRUNK, Session, onsets, unrelated

THRESHOLDS = Thresholds()
session = cache(people.session)

__all__ = [
    "ACTIONS",
    "DT",
    "JOINTS",
    "SKELETON",
    "THRESHOLDS",
    "TRUNK",
    "Session",
    "law_of",
    "of_people",
    "onsets",
    "own",
    "play",
    "put",
    "record_of",
    "session",
    "unrelated",
]  # fmt: skip


@cache
def own(number: int) -> tuple[Recogniser, Held]:
    """A simulated person's recogniser, from three repetitions."""
    return train(session(number).trials(), THRESHOLDS)


@cache
def of_people(numbers: tuple[int, ...], thresholds: Thresholds = THRESHOLDS) -> tuple[Recogniser, Held]:
    """A recogniser of several simulated people, each of whom was held out in turn."""
    return train([t for n in numbers for t in session(n, 2).trials(group=n)], thresholds)


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
