"""A recogniser for the law `intention` from InHARD, each person held out in turn."""

from __future__ import annotations

import datetime
from collections.abc import Collection
from pathlib import Path

import numpy as np

from srl.control.intention.features import FRAMES, RATE, frames, joints, trunk_of
from srl.control.intention.record import Record
from srl.control.intention.training import Held, Recogniser, Thresholds, Trial, train
from srl.sim.wearer import inhard


def trials(folder: Path, leave_out: Collection[str] = ("no-action",)) -> list[Trial]:
    """The data set's actions as trials; a group is a person. Those that are shorter than a window are left out.

    Args:
        folder: unpacked, as in `srl.sim.wearer.inhard`.
        leave_out: labels.
    Raises:
        RecordingError: a file isn't as it should be.
    """
    found: list[Trial] = []
    people: dict[str, int] = {}
    for action, motion in inhard.stretches(folder):
        if action.label in leave_out:
            continue
        at = np.round(np.arange(0.0, len(motion.rotation) / motion.rate, 1.0 / RATE) * motion.rate).astype(int)
        at = at[at < len(motion.rotation)]
        if len(at) < FRAMES:
            continue
        own = [motion.names.index(name) for name in joints(trunk_of(motion.names))]
        made = frames(motion.rotation[at][:, own], motion.translation[at][:, own])
        found.append(Trial(action.label, people.setdefault(action.subject, len(people)), made))
    return found


def recogniser(folder: Path, thresholds: Thresholds | None = None) -> tuple[Recogniser, Held, Record]:
    """A recogniser of all people, what it is worth on each who was held out, and its file.

    Raises:
        RecordingError, TrainingError: the data set can't be read, or has too little.
    """
    chosen = thresholds or Thresholds()
    made, held = train(trials(folder), chosen)
    trunk = trunk_of(inhard.motion(folder, inhard.actions(folder)[0].file).names)
    day = datetime.datetime.now(datetime.UTC).date()
    record = Record.of(made, held, chosen, person="InHARD", date=day, simulated=False, trunk=trunk)
    return made, held, record
