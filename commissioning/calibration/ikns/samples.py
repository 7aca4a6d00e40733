"""What a calibration's run gave, sample by sample, and which of it belongs to which trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from srl.commissioning.calibration.ikns.marks import IDLE, POINT, VOID, mark_of, of_trial
from srl.commissioning.calibration.marks import MarkedSamples, stretch_of
from srl.control.ikns.calibration import CalibrationError, Recording
from srl.control.ikns.clusters import Indices
from srl.runtime.contracts.signals import Array

LEAST_POINTS: Final = 8  # a box's corners
_GAP: Final = 1.0  # s, between the samples of two recordings


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        angles: (T, n) rad; not finite where a joint wasn't observed.
        hand: (T, 3) m; not finite where it wasn't.
        marks: (T,).
    """

    times: Array
    angles: Array
    hand: Array
    marks: Indices


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples one after another; the times of one that doesn't follow on are moved behind those before."""
    times: list[Array] = []
    end = -np.inf
    for part in parts:
        if not len(part):
            continue
        shift = 0.0 if part.times[0] > end else end + _GAP - part.times[0]
        times.append(part.times + shift)
        end = times[-1][-1]
    some = [part for part in parts if len(part)] or list(parts[:1])
    # In C order, whatever the parts' was: sums in another order would differ in the last bit.
    return Samples(
        np.concatenate(times) if times else np.empty(0), np.ascontiguousarray(np.concatenate([p.angles for p in some])),
        np.ascontiguousarray(np.concatenate([p.hand for p in some])), np.concatenate([p.marks for p in some]),
    )  # fmt: skip


def _counting(samples: Samples) -> Samples:
    """The samples with nothing to count in the trials that were broken off and at the points that were left out."""
    marks = samples.marks.copy()
    begins = np.flatnonzero(np.diff(marks, prepend=-1))
    for before, begin in zip((0, *begins), begins, strict=False):
        mark = int(marks[begin])
        if mark == VOID:
            marks[before:begin] = IDLE
        elif mark >= POINT and not of_trial(mark):
            earlier = marks[:begin]
            earlier[earlier // POINT == mark // POINT] = IDLE
    return replace(samples, marks=marks)


def seen(samples: Samples, at: slice) -> Array:
    """(T, 3) m: the hand's positions of those of the samples that have angles and hand."""
    whole = np.isfinite(np.column_stack([samples.angles[at], samples.hand[at]])).all(axis=1)
    found: Array = samples.hand[at][whole]
    return found


def trials(samples: Samples, dofs: int) -> tuple[Recording, tuple[int, ...]]:
    """Returns the samples of the trials, and the number (from 1) by which the person knows each point.

    A point without a trial of each DoF is left out. Raises CalibrationError: too few points are left.
    """
    samples = _counting(samples)
    points = sorted({int(mark) // POINT for mark in np.unique(samples.marks) if mark >= POINT})
    cuts: list[tuple[slice, int, int]] = []
    numbers: list[int] = []
    for number in points:
        own = [stretch_of(samples.marks, mark_of(number - 1, j)) for j in range(dofs)]
        if all(s.stop > s.start for s in own):
            cuts += [(s, len(numbers), j) for j, s in enumerate(own)]
            numbers.append(number)
    if len(numbers) < LEAST_POINTS:
        raise CalibrationError(
            "points", f"{len(numbers)} points have a trial of each DoF, {LEAST_POINTS} are needed",
            "Do the other points, too",
        )  # fmt: skip
    for at, i, _ in cuts:
        if not len(seen(samples, at)):
            raise CalibrationError(
                f"point {numbers[i]}", "no sample of its trial has angles and hand: markers were missing",
                "See that every marker is seen there, and redo the point",
            )  # fmt: skip
    cuts.sort(key=lambda cut: cut[0].start)
    take = np.concatenate([np.arange(s.start, s.stop) for s, _, _ in cuts])
    each = lambda k: np.concatenate([np.full(c[0].stop - c[0].start, c[k], np.intp) for c in cuts])  # noqa: E731
    found = Recording(samples.times[take], samples.angles[take], samples.hand[take], each(2), each(1))
    return found, tuple(numbers)


def whole(samples: Samples) -> Recording:
    """All samples of a recording without marks, for one DoF: its points are found by clusters alone."""
    return Recording(samples.times, samples.angles, samples.hand, np.zeros(len(samples), np.intp))
