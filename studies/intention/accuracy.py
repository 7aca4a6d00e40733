"""What the law `intention` is worth on simulated people: `python -m srl.studies.intention.accuracy [--people 12]`.

It says nothing about people.
"""

from __future__ import annotations

import argparse
import datetime
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from srl.control.intention.law import Intention, IntentionConfig
from srl.control.intention.record import Record
from srl.control.intention.training import Held, Recogniser, Thresholds, train
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.signals import Array
from srl.runtime.testing.bound import bound
from srl.sim.parts.body.motion import Script
from srl.studies.intention.people import DT, TRUNK, Session, onsets, session, unrelated

_KINDS: Final[tuple[Script, ...]] = ("still", "walk", "reach")
_SECONDS: Final = 60.0
_DAY: Final = datetime.date(2026, 1, 1)  # of a recogniser that no file keeps


def law_of(made: tuple[Recogniser, Held], thresholds: Thresholds, confirm: Literal["hold"] | None = None) -> Intention:
    """The law with a recogniser of simulated people, bound to arrays of its own."""
    record = Record.of(*made, thresholds, person="simulated", date=_DAY, simulated=True, trunk=TRUNK)
    file = KeptFile(Path("simulated.json"), record.model_dump_json().encode())
    return bound(Intention("intention", IntentionConfig(recogniser=file, confirm=confirm)))


def actions(law: Intention, rotation: Array, translation: Array, dt: float = DT) -> Array:
    """(T, k): the output `action` over a motion, from a reset at its beginning."""
    law.reset()
    found = np.zeros((len(rotation), law.output["action"].size))
    for row, q, p in zip(found, rotation, translation, strict=True):
        law.input["rotation"][:], law.input["translation"][:] = q, p
        law.update(dt)
        row[:] = law.output["action"]
    return found


def own(numbers: Sequence[int], repetitions: int = 5) -> dict[str, float]:
    """Each person with a recogniser of its own, in another session, in which the suit sits otherwise: shares."""
    thresholds, done, right, wrong = Thresholds(), 0, 0, 0
    for number in numbers:
        law = law_of(train(session(number, repetitions).trials(), thresholds), thresholds)
        other = session(number, seed=7)
        rows = other.held(actions(law, other.rotation, other.translation), law.outputs[0].labels)
        done += len(rows)
        right += sum(label in names for label, names in rows)
        wrong += sum(bool(names - {label}) for label, names in rows)
    return {"actions": done, "found": right / done, "another_too": wrong / done}


def strangers(numbers: Sequence[int]) -> dict[str, Any]:
    """One recogniser of several people: what it is worth on each who was held out, and on unrelated motion."""
    thresholds = Thresholds()
    made = train([t for n in numbers for t in session(n, 2).trials(group=n)], thresholds)
    law, held = law_of(made, thresholds), made[1]
    alarms: dict[str, float] = {}
    for kind in _KINDS:
        counts = [len(onsets(actions(law, *unrelated(kind, _SECONDS, seed)))) for seed in (1, 2, 3)]
        alarms[kind] = float(np.mean(counts) * 60.0 / _SECONDS)
    return {
        "windows_right": held.accuracy, "rejected": held.rejected,
        "actions_found": float(held.found.sum() / held.trials.sum()),
        "another_too": float(held.wrong.sum() / held.trials.sum()),
        "false_activations_per_minute": alarms, "temperature": made[0].discriminant.temperature,
    }  # fmt: skip


def rejects(numbers: Sequence[int], left_out: Sequence[str]) -> float:
    """The share of an unseen action's time, once the body is there, that is rejected; mean of people and actions."""
    thresholds, shares = Thresholds(), list[float]()
    for number in numbers:
        trials, other = session(number).trials(), session(number, seed=7)
        for action in left_out:
            law = law_of(train([t for t in trials if t.label != action], thresholds), thresholds)
            shares.append(_rejected(law, other, action))
    return float(np.mean(shares))


def _rejected(law: Intention, made: Session, action: str) -> float:
    law.reset()
    there = [(begin + 1.6, end) for begin, end, label, _ in made.labels if label == action]
    found = []
    for t, q, p in zip(made.times, made.rotation, made.translation, strict=True):
        law.input["rotation"][:], law.input["translation"][:] = q, p
        law.update(DT)
        if any(begin <= t < end for begin, end in there):
            found.append(law.output["rejected"][0])
    return float(np.mean(found))


def update_time(number: int = 1) -> float:
    """us: median of an update that looks at the window, by the processor's own time."""
    made, thresholds = session(number), Thresholds()
    law = law_of(train(made.trials(), thresholds), thresholds)
    law.reset()
    spent = []
    for q, p in zip(made.rotation, made.translation, strict=True):
        law.input["rotation"][:], law.input["translation"][:] = q, p
        before = time.thread_time_ns()
        law.update(DT)
        spent.append(time.thread_time_ns() - before)
    return float(np.median(spent)) * 1e-3


def main() -> None:
    """Prints the figures as one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=12, help="number of simulated people")
    numbers = range(1, 1 + parser.parse_args().people)
    summary = {
        "simulated": True, "people": len(numbers), "own": own(numbers), "strangers": strangers(numbers),
        "update_us": update_time(),
        "unseen_action_rejected": rejects(numbers[:4], ("overhead", "squat", "turn-left", "wave")),
    }  # fmt: skip
    print(json.dumps(summary, indent=1))


if __name__ == "__main__":
    main()
