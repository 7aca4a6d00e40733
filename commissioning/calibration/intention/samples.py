"""What a calibration's run gave, sample by sample, and which of it belongs to which trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.commissioning.calibration.intention.marks import EVERYDAY, IDLE, ROUND, VOID
from srl.commissioning.calibration.marks import Indices, MarkedSamples, stretch_of
from srl.control.intention.features import RATE
from srl.control.intention.training import BACKGROUND, Thresholds, TrainingError, Trial
from srl.control.intention.training import EVERYDAY as EVERYDAY_LABEL
from srl.runtime.contracts.signals import Array

LABELS: Final = (EVERYDAY_LABEL, *BACKGROUND)  # of the marks from EVERYDAY on
_LOST: Final = 0.1  # share of a trial's samples that may be missing
_STOP: Final = 0.25  # s between two samples from which on the run was stopped between them


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        frames: (T, FRAME), as in `features`; not finite where nothing was measured.
        marks: (T,).
    """

    times: Array
    frames: Array
    marks: Indices


def trials(parts: Sequence[Samples], actions: Sequence[str], thresholds: Thresholds) -> list[Trial]:
    """The trials of runs, in their order; what was done again replaces what was before. A stop is cut out.

    Raises TrainingError: none is there, or samples are missing in one.
    """
    found: dict[tuple[int, int], Trial] = {}
    for part in parts:
        marks, times = _counting(part.marks), _running(part.times)
        for mark in np.unique(marks[marks >= ROUND]).tolist():
            turn, number = mark // ROUND - 1, mark % ROUND
            background = number >= EVERYDAY
            label = LABELS[number - EVERYDAY] if background else actions[number - 1]
            at = stretch_of(marks, mark)
            lead = thresholds.settle if background else thresholds.lead
            frames = _regular(times[at], part.frames[at], lead)
            lost = 1.0 - np.isfinite(frames).all(axis=1).mean() if len(frames) else 1.0
            if lost > _LOST:
                place = label if background else f"action {label}"
                problem = f"{lost:.0%} of the samples of repetition {turn + 1} are missing"
                raise TrainingError(place, problem, "See that the suit is connected, and do it again")
            found[turn, number] = Trial(label, turn, _filled(frames))
    if not found:
        raise TrainingError("recording", "it has no trial", "Record with `srl calibrate PROFILE intention`")
    order = {label: i for i, label in enumerate((*actions, *BACKGROUND, EVERYDAY_LABEL))}
    return sorted(found.values(), key=lambda trial: (trial.group, order[trial.label]))


def _counting(marks: Indices) -> Indices:
    """The marks with nothing to count in the trials that were broken off."""
    marks = marks.copy()
    begins = np.flatnonzero(np.diff(marks, prepend=-1))
    for before, begin in zip((0, *begins), begins, strict=False):
        if marks[begin] == VOID:
            marks[before:begin] = IDLE
    return marks


def _running(times: Array) -> Array:
    """(T,) s on a clock that stands while the run is stopped: its posture must not be taken for one that was held."""
    steps = np.diff(times, prepend=times[:1])
    clock: Array = np.where(steps > _STOP, 1.0 / RATE, steps).cumsum()
    return clock


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
