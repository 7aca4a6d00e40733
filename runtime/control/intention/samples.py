"""What a calibration's run gave, sample by sample, with marks that say what the person was to do.

A mark is one number, so that it changes in one cycle: 0 nothing that counts; 100 * round + number in a trial, both from
1 on. The numbers are those of the actions in their order, then STAND and WALK. It is a parameter of the law
`intention-marks`. Where a trial was made again, the last one counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydantic import Field

from runtime.contracts.controller import ControllerConfig
from runtime.contracts.signals import Array
from runtime.control.intention.features import RATE
from runtime.control.intention.training import BACKGROUND, Thresholds, TrainingError, Trial
from runtime.control.shared.marks import Indices, MarkLaw, stretch_of
from runtime.control.shared.record_file import Name

IDLE: Final = 0
MOST_ROUNDS: Final = 50
STAND: Final = 98
WALK: Final = 99
_ROUND: Final = 100
_LOST: Final = 0.1  # share of a trial's samples that may be missing


def mark_of(turn: int, number: int) -> int:
    """The mark of a trial in a round, from 0 on; `number` is STAND, WALK, or an action's number, from 0 on."""
    return _ROUND * (turn + 1) + (number if number in (STAND, WALK) else number + 1)


@dataclass(frozen=True)
class Samples:
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        frames: (T, FRAME), as in `features`; not finite where nothing was measured.
        marks: (T,).
    """

    times: Array
    frames: Array
    marks: Indices

    def __len__(self) -> int:
        return len(self.times)


def ended(samples: Samples) -> Samples:
    """The samples of a whole recording: a trial in which it ended was broken off, so it doesn't count."""
    marks = samples.marks.copy()
    if len(marks) and marks[-1] >= _ROUND:
        marks[stretch_of(marks, int(marks[-1]))] = IDLE
    return replace(samples, marks=marks)


def trials(parts: Sequence[Samples], actions: Sequence[str], thresholds: Thresholds) -> list[Trial]:
    """The trials of runs, in their order; what was done again replaces what was before.

    Raises TrainingError: none is there, or samples are missing in one.
    """
    found: dict[tuple[int, int], Trial] = {}
    for part in parts:
        for mark in np.unique(part.marks[part.marks >= _ROUND]).tolist():
            turn, number = mark // _ROUND - 1, mark % _ROUND
            background = number in (STAND, WALK)
            label = BACKGROUND[number - STAND] if background else actions[number - 1]
            at = stretch_of(part.marks, mark)
            lead = thresholds.settle if background else thresholds.lead
            frames = _regular(part.times[at], part.frames[at], lead)
            lost = 1.0 - np.isfinite(frames).all(axis=1).mean() if len(frames) else 1.0
            if lost > _LOST:
                place = label if background else f"action {label}"
                problem = f"{lost:.0%} of the samples of repetition {turn + 1} are missing"
                raise TrainingError(place, problem, "See that the suit is connected, and do it again")
            found[turn, number] = Trial(label, turn, _filled(frames))
    if not found:
        raise TrainingError("recording", "it has no trial", "Record with `srl calibrate PROFILE intention`")
    order = {label: i for i, label in enumerate((*actions, *BACKGROUND))}
    return sorted(found.values(), key=lambda trial: (trial.group, order[trial.label]))


def _regular(times: Array, frames: Array, lead: float) -> Array:
    """The newest sample at each frame's time, from `lead` s after the first on."""
    if not len(times):
        return frames
    at = np.arange(times[0] + lead, times[-1] + 1e-9, 1.0 / RATE)
    found: Array = frames[np.searchsorted(times, at + 1e-9, side="right") - 1]
    return found


def _filled(frames: Array) -> Array:
    """Frames in which what is missing is as it was before, or as it is first."""
    seen = np.flatnonzero(np.isfinite(frames).all(axis=1))
    found: Array = frames[seen[np.maximum(np.searchsorted(seen, np.arange(len(frames)), side="right") - 1, 0)]]
    return found


class IntentionMarksConfig(ControllerConfig):
    """Options of `intention-marks`."""

    person: Name = Field(description="anonymous id")
    actions: tuple[Name, ...] = Field(min_length=2, max_length=90, description="their names, in the marks' order")
    trunk: tuple[Name, ...] = Field(min_length=1, description="joints of the trunk")
    rotation: dict[str, str] = Field(description="where each joint's rotation is: JOINT: SIGNAL[ELEMENT]")
    translation: dict[str, str] = Field(description="where each joint's translation is")
    thresholds: Thresholds = Field(default=Thresholds(), description="what is kept, and what is refused")


class IntentionMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = IntentionMarksConfig
    summary = "marks in the rows what actions the person was to do (srl calibrate PROFILE intention)"

    def __init__(self, name: str, config: IntentionMarksConfig) -> None:
        super().__init__(name, config)
        self.marks(mark_of(MOST_ROUNDS, WALK))
